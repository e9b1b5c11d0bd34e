//! A process whose loops run in threads serves messages in one, too.
#![cfg(feature = "linux")]

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use condor_mbox::linux::{Claim, LinuxSystem};
use condor_mbox::{MailboxError as MailError, Messenger, Processor, Vector};
use condor_rt::linux::{LinuxProcess, LoopContext};
use condor_rt::{Background, PROCESSORS, ProgramError, Setup};

use crate::environment;

const ME: Processor = Processor(3);
const VISITOR: Processor = Processor(20);
const COUNT: Vector = Vector(1);
const PATIENCE: Duration = Duration::from_secs(20);
const WINDOW_BYTES: u32 = 16384;

/// A program whose handler checks that numbers come in their order, and returns how many have come; its
/// background is `background`, while `visit` sends. Returns how many numbers came out of order.
fn with_visitor(
    background: impl FnOnce(&Background<'_, LinuxProcess>, &AtomicBool),
    visit: impl FnOnce(Claim<PROCESSORS>) + Send,
) -> u32 {
    let directory = tempfile::tempdir().unwrap();
    let environment =
        environment::environment(directory.path(), ME, WINDOW_BYTES, LoopContext::Threads);
    let machine = LinuxProcess::new(&environment, []).unwrap();
    let system = LinuxSystem::at(&environment.system, WINDOW_BYTES).unwrap();
    let claim = system.claim(VISITOR).unwrap();
    let (latest, wrong, gone) = (AtomicU32::new(0), AtomicU32::new(0), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| {
            visit(claim);
            gone.store(true, Ordering::Relaxed);
        });
        let count = |call: &condor_rt::HandlerCall<'_>| {
            let before = latest.load(Ordering::Relaxed);
            // Whoever else serves now comes in between.
            thread::yield_now();
            if before + 1 != call.data() {
                wrong.fetch_add(1, Ordering::Relaxed);
            }
            latest.store(call.data(), Ordering::Relaxed);
            call.data()
        };
        let ran = Setup::new(&machine)
            .unwrap()
            .on(COUNT, "count", &count)
            .background(|running| {
                background(running, &gone);
                Ok::<_, ProgramError>(())
            });
        ran.unwrap();
    });
    wrong.into_inner()
}

#[test]
fn a_message_is_answered_while_the_background_computes() {
    let answered = AtomicBool::new(false);
    let compute = |_: &Background<'_, LinuxProcess>, gone: &AtomicBool| {
        while !gone.load(Ordering::Relaxed) {
            std::hint::spin_loop();
        }
    };
    let wrong = with_visitor(compute, |claim| {
        let mut mailbox = claim.mailbox().unwrap();
        mailbox.join().unwrap();
        let replies = (1..=3).map(|data| mailbox.send_with_reply(ME, COUNT, data, PATIENCE));
        answered.store(replies.eq([Ok(1), Ok(2), Ok(3)]), Ordering::Relaxed);
    });
    assert_eq!((answered.into_inner(), wrong), (true, 0));
}

#[test]
fn messages_keep_their_order_though_the_background_serves_too() {
    const MESSAGES: u32 = 20_000;
    let sent = AtomicU32::new(0);
    let served = AtomicU32::new(0);
    let serve = |background: &Background<'_, LinuxProcess>, gone: &AtomicBool| {
        while !gone.load(Ordering::Relaxed) {
            let count = background.mailbox().serve(Duration::from_millis(1));
            served.fetch_add(count.unwrap() as u32, Ordering::Relaxed);
        }
    };
    let wrong = with_visitor(serve, |claim| {
        let mut mailbox = claim.mailbox().unwrap();
        mailbox.join().unwrap();
        let until = mailbox.now().after(PATIENCE);
        for number in 1..MESSAGES {
            while mailbox.send(ME, COUNT, number, PATIENCE) != Ok(()) {
                assert!(mailbox.now() < until);
            }
        }
        let last: Result<_, MailError> = mailbox.send_with_reply(ME, COUNT, MESSAGES, PATIENCE);
        sent.store(last.unwrap(), Ordering::Relaxed);
    });
    assert_eq!((sent.into_inner(), wrong), (MESSAGES, 0));
    assert!(served.into_inner() > 0, "the background has served, too");
}
