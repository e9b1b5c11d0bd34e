//! Truncates the memory of one process under the eyes of the others.

use std::fs::File;
use std::sync::atomic::{AtomicBool, Ordering};

use condor_mbox::error::MemoryObject;
use condor_mbox::linux::{LinuxMailbox, LinuxSystem};
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{Call, MailboxError, Messenger, Processor};

use super::AnyError;
use super::everyone::{ANSWER, BYTES, MET, NAME, WAIT, open, with_space};
use super::process::Process;
use super::talk::{LONG, N, answer};

/// Calls of another process that must go well afterwards.
const CALLS: u32 = 1000;
const ME: Processor = Processor(0);
const OTHER: Processor = Processor(1);
const LOST: Processor = Processor(2);

/// What became of it.
#[derive(Default)]
pub(crate) struct Truncation {
    /// Good replies of the other process after the truncation.
    pub(crate) others: u32,
    pub(crate) faults: u32,
}

/// Truncates the `mail` of a process that holds a call of ours.
pub(crate) fn truncate() -> Result<Truncation, AnyError> {
    let mut seen = Truncation::default();
    let name = format!("faults-truncated-{}", std::process::id());
    let system = with_space(|| LinuxSystem::<N>::named(&name, BYTES))?;
    let claim = with_space(|| system.claim(ME))?;
    let start = |number: Processor| {
        Process::start(&format!("member {}", number.0), |command| {
            command.env(NAME, &name);
        })
    };
    let (mut other, mut lost) = (start(OTHER)?, start(LOST)?);
    let answers = |call: &Call<'_>| answer(call.data(), ME);
    let mailbox = open(&claim, &answers)?;
    let (has_met, waits) = (AtomicBool::new(false), AtomicBool::new(false));
    let faults = std::thread::scope(|threads| {
        let caller = threads.spawn(|| call_until_lost(&mailbox, &has_met, &waits));
        for member in [&mut other, &mut lost] {
            if member.hear()?.as_deref() != Some(MET) {
                seen.fault("a process met nobody");
            }
        }
        has_met.store(true, Ordering::Release);
        while !waits.load(Ordering::Acquire) && !caller.is_finished() {
            std::thread::yield_now();
        }
        // Anybody who may take part can do this.
        let path = format!("/dev/shm/condor-{name}/{}.mail", LOST.0);
        File::options().write(true).open(path)?.set_len(0)?;
        caller
            .join()
            .map_err(|_| AnyError::from("the caller panicked"))
    })?;
    match faults {
        Ok(replies) => seen.others = replies,
        Err(error) => seen.fault(&error),
    }
    let status = lost.wait()?;
    if !status.success() {
        seen.fault(&format!(
            "the process whose memory was truncated ended with {status}"
        ));
    }
    drop((other, mailbox, claim));
    system.remove()?;
    Ok(seen)
}

/// Calls both processes, then waits for the one that loses its memory, then goes on with the other;
/// gives the number of good replies after the loss.
fn call_until_lost(
    mailbox: &LinuxMailbox<'_, N>,
    has_met: &AtomicBool,
    waits: &AtomicBool,
) -> Result<u32, String> {
    let call = |to, data| match mailbox.send_with_reply(to, ANSWER, data, LONG) {
        Ok(told) if told == answer(data, to) => Ok(()),
        outcome => Err(format!("{to} replied {outcome:?} to {data}")),
    };
    for data in 1.. {
        if has_met.load(Ordering::Acquire) {
            break;
        }
        call(OTHER, data)?;
        call(LOST, data)?;
    }
    let expect_loss = |vector| match mailbox.send_with_reply(LOST, vector, 1, LONG) {
        Err(MailboxError::Window {
            processor: LOST,
            object: MemoryObject::Mail,
            kind: WindowErrorKind::Lost,
        }) => Ok(()),
        outcome => Err(format!("a call to truncated memory: {outcome:?}")),
    };
    waits.store(true, Ordering::Release);
    expect_loss(WAIT)?;
    for data in 0..CALLS {
        call(OTHER, data)?;
        expect_loss(ANSWER)?;
    }
    Ok(CALLS)
}

impl Truncation {
    fn fault(&mut self, what: &str) {
        eprintln!("WRONG: {what}");
        self.faults += 1;
    }
}
