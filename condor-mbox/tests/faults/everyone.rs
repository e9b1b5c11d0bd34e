//! Kills every process of a named system, again and again, and cleans nothing up.

use std::io::ErrorKind;
use std::os::unix::process::ExitStatusExt;
use std::time::{Duration, Instant};

use condor_mbox::linux::{Claim, LinuxMailbox, LinuxSystem, SystemError};
use condor_mbox::{Call, CriticalSection, Handler, MailboxError, Messenger, Processor, Vector};
use rustix::process::Signal;

use super::AnyError;
use super::director::pause;
use super::process::Process;
use super::random::Random;
use super::talk::{LONG, N, answer};

/// Bytes of users' data.
pub(crate) const BYTES: u32 = 4096;
/// Replies with [`answer`].
pub(crate) const ANSWER: Vector = Vector(1);
/// Replies after [`WAITING`].
pub(crate) const WAIT: Vector = Vector(2);
/// Longer than it takes to truncate a file.
const WAITING: Duration = Duration::from_secs(1);
/// A process is killed at most this long after it was started, or after it met the others.
const START: Duration = Duration::from_millis(4);
/// What a member says when all others have answered it.
pub(crate) const MET: &str = "met";

/// What became of all.
#[derive(Default)]
pub(crate) struct Everyone {
    pub(crate) rounds: u32,
    pub(crate) killed: u32,
    pub(crate) faults: u32,
}

/// Starts all processes of a new system and kills them all, `rounds` times; half of the times
/// before they may have met.
pub(crate) fn kill_all(rounds: u32, seed: u64) -> Result<Everyone, AnyError> {
    let mut random = Random::new(seed);
    let mut everyone = Everyone::default();
    // The first process creates the files.
    let name = format!("faults-{}", std::process::id());
    for round in 0..2 * rounds {
        let early = round % 2 == 0;
        let start = |number| {
            Process::start(&format!("member {number}"), |command| {
                command.env(NAME, &name);
            })
        };
        let mut members = (0..N).map(start).collect::<Result<Vec<_>, _>>()?;
        for (number, member) in members.iter_mut().enumerate().filter(|_| !early) {
            if member.hear()?.as_deref() != Some(MET) {
                everyone.fault(&format!("round {round}: member {number} met nobody"));
            }
        }
        pause(random.span(START));
        let first = random.below(N as u32) as usize;
        members.rotate_left(first);
        for member in &members {
            member.signal(Signal::KILL)?;
        }
        for member in &mut members {
            let status = member.wait()?;
            if status.signal() != Some(Signal::KILL.as_raw()) {
                everyone.fault(&format!("round {round}: a member ended with {status}"));
            }
            everyone.killed += 1;
        }
    }
    everyone.rounds = 2 * rounds;
    with_space(|| LinuxSystem::<N>::named(&name, BYTES))?.remove()?;
    Ok(everyone)
}

/// Does `what` once there is space for the files of a named system.
pub(crate) fn with_space<T>(what: impl Fn() -> Result<T, SystemError>) -> Result<T, SystemError> {
    loop {
        match what() {
            Err(SystemError::Os { source, .. }) if source.kind() == ErrorKind::StorageFull => {
                pause(START);
            }
            outcome => return outcome,
        }
    }
}

impl Everyone {
    fn fault(&mut self, what: &str) {
        eprintln!("WRONG: {what}");
        self.faults += 1;
    }
}

/// The environment variable with the name of the system.
pub(crate) const NAME: &str = "CONDOR_FAULTS_NAME";

/// Plays one process of the named system: calls the others, answers them, and says when it has
/// met all; ends well only if it has lost its own memory.
pub(crate) fn play(number: u8) -> Result<(), AnyError> {
    let name = std::env::var(NAME)?;
    let claim = with_space(|| LinuxSystem::<N>::named(&name, BYTES)?.claim(Processor(number)))?;
    let me = claim.number();
    let answers = |call: &Call<'_>| answer(call.data(), me);
    let mailbox = open(&claim, &answers)?;
    let begun = Instant::now();
    let mut met = [false; N];
    met[me.index()] = true;
    for data in 1.. {
        for other in (0..N as u8).map(Processor).filter(|&other| other != me) {
            match mailbox.send_with_reply(other, ANSWER, data, LONG) {
                Ok(told) if told == answer(data, other) => {
                    let had_met = met.iter().all(|&met| met);
                    met[other.index()] = true;
                    if !had_met && met.iter().all(|&met| met) {
                        println!("{MET}");
                    }
                }
                Ok(told) => return Err(format!("{other} answered {told:#x} to {data}").into()),
                Err(MailboxError::Window { processor, .. }) if processor == me => break,
                // They start and end when they like, and lose what they like.
                Err(
                    MailboxError::PeerDied { .. }
                    | MailboxError::PeerRestarted { .. }
                    | MailboxError::Window { .. },
                ) => {}
                Err(error) => return Err(error.into()),
            }
        }
        if mailbox.serve(Duration::ZERO).is_err() {
            break;
        }
        if begun.elapsed() > LONG && met.contains(&false) {
            return Err(format!("{me} does not meet the others: {met:?}").into());
        }
    }
    Ok(())
}

/// A mailbox of `claim` that has joined and answers.
pub(crate) fn open<'v>(
    claim: &Claim<N>,
    answers: Handler<'v>,
) -> Result<LinuxMailbox<'v, N>, MailboxError> {
    let (windows, doorbell) = (claim.windows().clone(), claim.doorbell().clone());
    let mut mailbox = LinuxMailbox::new(claim.number(), windows, doorbell, CriticalSection)?;
    mailbox.set_vector(ANSWER, answers, "answer")?;
    mailbox.set_vector(WAIT, &wait, "wait")?;
    mailbox.join()?;
    Ok(mailbox)
}

fn wait(call: &Call<'_>) -> u32 {
    let begun = Instant::now();
    while begun.elapsed() < WAITING {
        std::thread::yield_now();
    }
    call.data()
}
