//! LAYOUT.md suffices to write the other end of a mailbox: one in C, in a process of its own.
#![cfg(feature = "linux")]

use std::path::Path;
use std::process::{Child, Command};
use std::time::Duration;

use condor_mbox::linux::{LinuxMailbox, LinuxSystem};
use condor_mbox::{
    Call, Clock, CriticalSection, MailboxError, Messenger, PeerState, Processor, Vector,
};

const ME: Processor = Processor(0);
const C: Processor = Processor(1);
const DOUBLE: Vector = Vector(5);
const ASK_BACK: Vector = Vector(6);
const STOP: Vector = Vector(7);
/// Never reached unless something is lost.
const GENEROUS: Duration = Duration::from_secs(100);

fn compiled(directory: &Path) -> Command {
    let program = directory.join("other_end");
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let source =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/processes/other_end/other_end.c");
    let mut command = Command::new(compiler);
    command.args(["-std=gnu11", "-O2", "-Wall", "-Wextra", "-o"]);
    assert!(
        command
            .arg(&program)
            .arg(source)
            .status()
            .unwrap()
            .success()
    );
    Command::new(program)
}

/// A process that is killed if the test fails before it ends by itself.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn serve_until(mailbox: &LinuxMailbox<'_, 2>, what: &str, found: impl Fn(PeerState) -> bool) {
    let until = mailbox.doorbell().now().after(GENEROUS);
    while !found(mailbox.peer_state(C).unwrap()) {
        assert!(mailbox.doorbell().now() < until, "{what}");
        mailbox.serve(Duration::from_millis(10)).unwrap();
    }
}

#[test]
fn an_end_in_c_calls_and_is_called_and_restarts() {
    let directory = tempfile::tempdir().unwrap();
    let place = directory.path().join("system");
    let (windows, doorbell) = LinuxSystem::<2>::at(&place, 64)
        .unwrap()
        .claim(ME)
        .unwrap()
        .into_parts();
    let triple = |call: &Call<'_>| call.data().wrapping_mul(3);
    let mut mailbox = LinuxMailbox::new(ME, windows, doorbell, CriticalSection).unwrap();
    mailbox.set_vector(ASK_BACK, &triple, "triple").unwrap();
    mailbox.join().unwrap();

    let mut other_end = compiled(directory.path());
    other_end.arg(&place);
    for incarnation in 1..=3 {
        let mut process = Process(other_end.spawn().unwrap());
        serve_until(&mailbox, "it joins", |state| {
            let connected = true;
            state
                == PeerState::Up {
                    incarnation,
                    connected,
                }
        });
        for data in 0..100 {
            mailbox.send(C, DOUBLE, data, GENEROUS).unwrap();
            let reply = mailbox.send_with_reply(C, DOUBLE, data, GENEROUS);
            assert_eq!(reply, Ok(2 * data));
            let reply = mailbox.send_with_reply(C, ASK_BACK, data, GENEROUS);
            assert_eq!(reply, Ok(3 * data + 1));
        }
        let no_handler = Err(MailboxError::NoHandler {
            to: C,
            vector: Vector(9),
        });
        assert_eq!(
            mailbox.send_with_reply(C, Vector(9), 0, GENEROUS),
            no_handler
        );
        let statistics = mailbox.vector_statistics(C, DOUBLE).unwrap();
        assert_eq!(statistics.name(), "twce");
        if incarnation == 2 {
            process.0.kill().unwrap();
            process.0.wait().unwrap();
            let error = mailbox.send_with_reply(C, DOUBLE, 0, GENEROUS).unwrap_err();
            assert!(matches!(error, MailboxError::PeerDied { .. }), "{error}");
        } else {
            assert_eq!(mailbox.send_with_reply(C, STOP, 0, GENEROUS), Ok(0));
            assert!(process.0.wait().unwrap().success());
            assert_eq!(mailbox.peer_state(C), Ok(PeerState::Absent));
        }
    }
}
