//! Static variables of a process, by the debug information of its program.

use std::process::Command;
use std::time::Instant;

use crate::running::{DEADLINE, Up};

/// A program that joins nothing, and counts.
const SOURCE: &str = r"
use std::sync::atomic::{AtomicU32, Ordering};

struct Counts {
    turns: AtomicU32,
    limits: [f64; 2],
}

static COUNTS: Counts = Counts { turns: AtomicU32::new(0), limits: [0.5, 2.5] };

fn main() {
    while COUNTS.limits[0] < f64::from(COUNTS.turns.load(Ordering::Relaxed)) + 1.0 {
        COUNTS.turns.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
}
";

#[test]
fn numbers_of_a_process_are_printed_and_set() {
    let place = tempfile::tempdir().unwrap();
    let program = place.path().join("counter");
    std::fs::write(place.path().join("counter.rs"), SOURCE).unwrap();
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let compiled = Command::new(rustc)
        .args(["-g", "counter.rs"])
        .current_dir(place.path())
        .status();
    assert!(compiled.unwrap().success());
    let program = program.display();
    let up = Up::launch(
        &format!(
            "[[processors]]\nnumber = 0\nname = \"a\"\nprogram = {:?}\n",
            program.to_string()
        ),
        &[],
        |_| {},
    );
    // A program that does not join is killed and started again after some time.
    let until_told = |expression: &str, text: &str| {
        let end = Instant::now() + DEADLINE;
        loop {
            let output = up.command(&["print", "a", expression]).output().unwrap();
            let told = [output.stdout, output.stderr].concat();
            let told = String::from_utf8(told).unwrap();
            if told.contains(text) {
                return;
            }
            assert!(Instant::now() < end, "{told}");
        }
    };
    until_told("COUNTS.limits[1]", "COUNTS.limits[1] = 2.5\n");
    until_told("counter::COUNTS.turns=4000000000", "turns = 40000000");
    until_told("COUNTS.limits[2]", "`COUNTS.limits` has no part `[2]`");
}
