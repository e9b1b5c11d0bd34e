//! What the supervisor starts: this program again, told by its environment what to be.

use std::process::ExitCode;

use crate::finger::Finger;
use crate::writer::Writer;

/// Not a test: the program of a processor.
#[test]
#[ignore = "a program that a supervisor starts"]
fn program() {
    let words = std::env::var("CONDOR_TEST_PROGRAM").unwrap_or_default();
    let mut words = words.split(' ').map(String::from);
    let code = match words.next().as_deref() {
        // SAFETY: the program has no loops.
        Some("writer") => unsafe { condor_host::linux::run(&Writer, words) },
        // SAFETY: its loop computes and stores.
        Some("finger") => unsafe { condor_host::linux::run(&Finger, words) },
        _ => {
            eprintln!("this program fails");
            ExitCode::FAILURE
        }
    };
    if code != ExitCode::SUCCESS {
        std::process::exit(3);
    }
}
