//! What the supervisor starts: this program again, told by its environment what to be.

use std::process::{Command, ExitCode};

use condor_rt::numbers::MISTAKE;

use crate::asker::Asker;
use crate::boards::Echo;
use crate::diary::Diary;
use crate::held::Divider;
use crate::joint::Joint;
use crate::late::Late;
use crate::writer::Writer;

/// Not a test: the program of a processor.
#[test]
#[ignore = "a program that a supervisor starts"]
fn program() {
    let words = std::env::var("CONDOR_TEST_PROGRAM").unwrap_or_default();
    let mut words = words.split(' ').map(String::from);
    let code = match words.next().as_deref() {
        Some("writer") => condor_rt::linux::run(&Writer, words),
        Some("diary") => condor_rt::linux::run(&Diary, words),
        Some("divider") => condor_rt::linux::run(&Divider, words),
        Some("joint") => condor_rt::linux::run(&Joint, words),
        Some("asker") => condor_rt::linux::run(&Asker, words),
        Some("echo") => condor_rt::linux::run(&Echo, words),
        Some("late") => condor_rt::linux::run(&Late, words),
        Some("printer") => {
            std::thread::spawn(|| {
                loop {
                    println!("\x1b[2Jand on and on");
                }
            });
            condor_rt::linux::run(&Writer, words)
        }
        Some("parent") => {
            // One in the group of this program, and one that has detached itself.
            for detach in ["", "setsid "] {
                let command = format!("{detach}sleep 1000 & echo descendant $!");
                let status = Command::new("sh").args(["-c", &command]).status();
                assert!(status.is_ok_and(|status| status.success()));
            }
            condor_rt::linux::run(&Writer, words)
        }
        _ => {
            eprintln!("this program fails");
            ExitCode::FAILURE
        }
    };
    if code == ExitCode::from(MISTAKE) {
        std::process::exit(MISTAKE.into());
    }
    if code != ExitCode::SUCCESS {
        std::process::exit(3);
    }
}
