//! [`Stress`]: everybody sends to everybody, and counts.
//!
//! Each of the processors that `peers=` names sends numbered messages to each of the others: from its
//! background, without reply and with (the receiver asks back, nested, before it answers), and from a
//! loop at 400 Hz, above a loop at 100 Hz that computes. After `seconds=` all stop sending, compare what
//! they have received with what the others say they have sent, and publish a [`Verdict`].
//!
//! With `exact` a skipped release is wrong, too.

mod tally;

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
use core::time::Duration;

use condor_mbox::published::{PublishedReadError, Publisher};
use condor_mbox::{
    self as mbox, Clock as _, Doorbell as _, Instant, MessageTicket, Messenger, Processor, Region,
};
use condor_mos::Rate;
use condor_rt::{Background, Machine, Program, ProgramError, Setup};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::arguments::{self, Peers};
use crate::{WRONG, late};
pub use tally::SHARED_BYTES;
use tally::{ASK, Counts, NOTE, TICK, Tally};

/// The name under which a [`Verdict`] is published.
pub const NAME: &str = "verdict";

/// Nothing takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(30);
/// The time that a look for messages waits.
const NAP: Duration = Duration::from_millis(5);
const LOOPS: [&str; 2] = ["fast", "slow"];
const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(100)];
/// The depth to which receivers of a message with a reply ask back.
const DEPTH: u32 = 2;

/// The program.
///
/// It is given a function that says how deep the stack of this processor has been, in bytes, where that
/// is known.
#[derive(Clone, Copy, Debug)]
pub struct Stress<F>(pub F);

/// The results of the program.
#[derive(Clone, Copy, Debug, Default, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Verdict {
    /// 1 after the count.
    pub is_complete: u32,
    /// Messages that came not right after the one before from the same sender, replies and sums that
    /// are wrong, and messages that are missing in the end.
    pub wrong: u32,
    /// Messages without reply that were received, of backgrounds.
    pub notes: u32,
    /// Messages without reply that were received, of loops.
    pub ticks: u32,
    /// Calls that were answered.
    pub calls: u32,
    /// Calls that were asked back, nested, while they were answered.
    pub nested: u32,
    /// Releases of both loops.
    pub released: [u32; 2],
    /// Releases that were skipped.
    pub skipped: [u32; 2],
    /// The difference between the releases of the loops and those that were due in the time that passed.
    pub drift: [u32; 2],
    /// The worst lateness of each, in ticks of the timer.
    pub lateness: [u32; 2],
    /// The greatest depth of the stack, in bytes; 0 if it is not known.
    pub stack: u32,
}

impl<F: Fn() -> u32> Program for Stress<F> {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let peers = Peers::of(machine, "peers")?;
        let seconds = arguments::number(machine, "seconds", 60)?;
        let mut setup = Setup::new(machine)?;
        let board = machine.shared_memory();
        let board = board.ok_or(ProgramError::Missing {
            what: "shared memory",
        })?;
        let verdict = setup.publish::<Verdict>(NAME)?;
        let tally = Tally::default();
        // Loops send while the background does.
        let sends = AtomicBool::new(false);
        let sum = compute();
        setup
            .console()?
            .on(NOTE, "note", &|call| tally.note(call))
            .on(TICK, "tick", &|call| tally.tick(call))
            .on(ASK, "ask", &|call| tally.answer(call, PATIENCE))
            .servo(LOOPS[0], RATES[0], &mut |tick| {
                if let Some(peer) = peers.nth(tick.number).filter(|_| sends.load(Relaxed)) {
                    let number = tally.next_tick(peer);
                    // If there is no room, the message is sent another time.
                    if tick.send(peer, TICK, number).is_ok() {
                        tally.tick_sent(peer, number);
                    }
                }
            })
            .servo(LOOPS[1], RATES[1], &mut |_| tally.check(compute() == sum))
            .background(|background| {
                let running = Running {
                    background,
                    tally: &tally,
                    peers,
                    sends: &sends,
                    board,
                };
                running.all(seconds, verdict, &self.0)
            })
    }
}

/// The parts of a drill that runs.
struct Running<'r, M: Machine> {
    background: &'r Background<'r, M>,
    tally: &'r Tally,
    peers: Peers,
    sends: &'r AtomicBool,
    /// The memory that belongs to no processor, where each publishes how far it is, and how much it has
    /// sent.
    board: Region<M::Window>,
}

impl<M: Machine> Running<'_, M> {
    fn all(
        &self,
        seconds: u32,
        mut published: Publisher<Verdict, Region<M::Window>>,
        stack: &impl Fn() -> u32,
    ) -> Result<(), ProgramError> {
        let me = self.background.machine().number();
        let mut counts = tally::counts_of(me).publisher(self.board.clone())?;
        counts.publish(&self.tally.counts(tally::JOINED))?;
        self.meet(tally::JOINED)?;
        let mut verdict = self.send_all(seconds)?;
        counts.publish(&self.tally.counts(tally::SENT))?;
        self.meet(tally::SENT)?;
        let missing = self.receive_rest()?;
        verdict.is_complete = 1;
        verdict.wrong = verdict
            .wrong
            .saturating_add(self.tally.wrong())
            .saturating_add(missing);
        verdict.stack = stack();
        self.tally.fill(&mut verdict);
        published.publish(&verdict)?;
        self.background.print(format_args!(
            "{} notes, {} ticks, {} calls, {} nested; {} wrong, drift {:?}, skipped {:?}\n",
            verdict.notes,
            verdict.ticks,
            verdict.calls,
            verdict.nested,
            verdict.wrong,
            verdict.drift,
            verdict.skipped,
        ));
        // Those who still compare need what is here.
        counts.publish(&self.tally.counts(tally::COMPARED))?;
        self.meet(tally::COMPARED)?;
        if verdict.wrong > 0 || verdict.drift.iter().any(|&drift| drift > 1) {
            return Err(ProgramError::program(&WRONG));
        }
        Ok(())
    }

    /// Sends from background and loops, until the time is over.
    fn send_all(&self, seconds: u32) -> Result<Verdict, ProgramError> {
        let machine = self.background.machine();
        let clock = machine.doorbell();
        // Loops that ran while others were still being started were held up.
        let before = clock.now();
        for name in LOOPS {
            self.background.reset_statistics(name)?;
        }
        let begun = clock.now();
        self.sends.store(true, Relaxed);
        let end = begun.after(Duration::from_secs(seconds.into()));
        let sum = compute();
        while clock.now() < end && !machine.is_stopping() {
            for peer in self.peers.iter() {
                self.note(peer)?;
                self.ask(peer)?;
            }
            self.tally.check(compute() == sum);
            self.background.show()?;
        }
        self.sends.store(false, Relaxed);
        // A run that found it true may go on beside this; those that begin from here on find it false.
        let deadline = clock.now().after(PATIENCE);
        while self.background.statistics(LOOPS[0])?.running > 0 && clock.now() < deadline {
            self.look(NAP)?;
        }
        let mut verdict = Verdict::default();
        for (number, (name, rate)) in LOOPS.into_iter().zip(RATES).enumerate() {
            let due = |since: Instant| {
                let passed = clock.now().ns_since(since);
                passed * u64::from(rate.numerator()) / 1_000_000_000
            };
            // A release that is only late is made up for now.
            let (first, deadline) = (due(begun), clock.now().after(PATIENCE));
            let mut counts = self.background.statistics(name)?;
            while counts.released < first && clock.now() < deadline {
                counts = self.background.statistics(name)?;
            }
            // One more than the periods that have passed may be due.
            let ahead = counts.released.saturating_sub(due(before) + 1);
            let behind = first.saturating_sub(counts.released);
            verdict.set_loop(number, &counts, ahead.max(behind) as u32);
        }
        if arguments::is_there(machine, "exact") {
            verdict.wrong = verdict.skipped.iter().sum();
        }
        Ok(verdict)
    }

    /// Sends a message without reply.
    fn note(&self, peer: Processor) -> Result<(), ProgramError> {
        let number = self.tally.next_note(peer);
        self.until(peer, || {
            match self
                .background
                .mailbox()
                .send(peer, NOTE, number, Duration::ZERO)
            {
                Ok(()) => Ok(Some(())),
                Err(mbox::MailboxError::NoSlot { .. }) => Ok(None),
                Err(error) => Err(error),
            }
        })?;
        self.tally.note_sent(peer, number);
        Ok(())
    }

    /// Sends a message with a reply, and checks the reply.
    fn ask(&self, peer: Processor) -> Result<(), ProgramError> {
        let question = self.tally.next_question(DEPTH);
        let mut ticket: Option<MessageTicket<'_>> = None;
        let reply = self.until(peer, || {
            let Some(ticket) = &mut ticket else {
                match self
                    .background
                    .mailbox()
                    .begin(peer, ASK, question, Duration::ZERO)
                {
                    Ok(begun) => ticket = Some(begun),
                    Err(mbox::MailboxError::NoSlot { .. }) => {}
                    Err(error) => return Err(error),
                }
                return Ok(None);
            };
            ticket.poll()
        })?;
        self.tally.check(reply == tally::answer_to(question));
        Ok(())
    }

    /// Tries until it succeeds. Where an interrupt serves, the background must not.
    fn until<R>(
        &self,
        peer: Processor,
        mut attempt: impl FnMut() -> Result<Option<R>, mbox::MailboxError>,
    ) -> Result<R, ProgramError> {
        let clock = self.background.machine().doorbell();
        let deadline = clock.now().after(PATIENCE);
        loop {
            if let Some(result) = attempt()? {
                return Ok(result);
            }
            if clock.now() >= deadline {
                return Err(late(peer));
            }
            self.look(Duration::from_micros(100))?;
        }
    }

    fn look(&self, nap: Duration) -> Result<(), ProgramError> {
        let bell = self.background.machine().doorbell();
        let seen = bell.prepare();
        // With an interrupt, whatever comes is served before the wait returns.
        if self.background.machine().mail_interrupts()
            || self.background.mailbox().serve(Duration::ZERO)? == 0
        {
            bell.wait(seen, bell.now().after(nap), None);
        }
        Ok(())
    }

    /// Waits until all peers have come as far.
    fn meet(&self, state: u32) -> Result<(), ProgramError> {
        let clock = self.background.machine().doorbell();
        for peer in self.peers.iter() {
            let deadline = clock.now().after(PATIENCE);
            loop {
                let counts = self.counts(peer)?;
                let is_far = counts.is_some_and(|counts| counts.state >= state);
                let is_up = state > tally::JOINED
                    || matches!(
                        self.background.mailbox().peer_state(peer)?,
                        condor_mbox::PeerState::Up {
                            connected: true,
                            ..
                        }
                    );
                if is_far && is_up {
                    break;
                }
                if clock.now() >= deadline {
                    return Err(late(peer));
                }
                self.look(NAP)?;
            }
        }
        Ok(())
    }

    /// Returns the counts that a peer has published; `None` if there are none yet.
    fn counts(&self, peer: Processor) -> Result<Option<Counts>, ProgramError> {
        match tally::counts_of(peer).subscriber(&self.board)?.read() {
            Ok(latest) => Ok(Some(latest.value)),
            Err(PublishedReadError::Access(error)) => Err(error.into()),
            Err(_) => Ok(None),
        }
    }

    /// Receives what is still on its way; how many messages are missing in the end.
    fn receive_rest(&self) -> Result<u32, ProgramError> {
        let clock = self.background.machine().doorbell();
        let deadline = clock.now().after(PATIENCE);
        let me = self.background.machine().number();
        loop {
            let mut missing = 0_u32;
            for peer in self.peers.iter() {
                let sent = self.counts(peer)?;
                let sent = sent.ok_or_else(|| late(peer))?;
                missing = missing.saturating_add(self.tally.missing(me, peer, &sent));
            }
            if missing == 0 || clock.now() >= deadline {
                return Ok(missing);
            }
            self.look(NAP)?;
        }
    }
}

impl Verdict {
    fn set_loop(&mut self, number: usize, counts: &condor_mos::Statistics, drift: u32) {
        let set = |all: &mut [u32; 2], value| {
            if let Some(one) = all.get_mut(number) {
                *one = value;
            }
        };
        set(&mut self.released, counts.released as u32);
        set(&mut self.skipped, counts.skipped as u32);
        set(&mut self.lateness, counts.worst_lateness);
        set(&mut self.drift, drift);
    }
}

/// Computes in floating-point registers for a while; returns the bits of the result.
fn compute() -> u64 {
    let (mut even, mut odd) = (core::hint::black_box(1.0_f64), core::hint::black_box(0.5));
    for _ in 0..2000 {
        even = even * 0.75 + odd;
        odd = odd * 0.5 + even * 0.125;
    }
    (even + odd).to_bits()
}
