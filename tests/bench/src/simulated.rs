//! `simulated`: how fast the processes of the hand go through simulated time, alone and beside busy loops.

use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use crate::Result;
use crate::build::programs;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::rounds;

/// Loops that compute all the time, on a machine of two cores.
const BUSY: usize = 8;
/// The text after the factor in the summary of a run.
const FACTOR: &str = " × real time";

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(7, 7);
    let span = if options.quick { "10s" } else { "60s" };
    let tree = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let program = programs(&tree, &["-p", "utah-mit-hand"])?.join("utah-mit-hand");
    let played = rounds::play(rounds, |_| {
        Ok([factor(&program, span)?, beside_busy_loops(&program, span)?])
    })?;
    let of = |place: usize| Estimate::of(played.iter().map(|round| round[place]));
    let (alone, busy) = (of(0), of(1));
    let text = format!(
        "{rounds} rounds of {span} of the hand with its simulated robot: five processors in five processes,\n\
         and two services. Simulated seconds per real second; medians, with the interval that holds the\n\
         true median in 95 of 100 runs.\n\n\
         alone                   {alone}\n\
         beside {BUSY} busy loops     {busy}\n"
    );
    let goals = vec![
        Goal::least("simulated_alone", alone, 5.0),
        Goal::least("simulated_beside_busy_loops", busy, 1.0),
    ];
    Ok(Report { text, goals })
}

/// Returns the simulated seconds per real second, as the summary of a run says.
fn factor(program: &Path, span: &str) -> Result<f64> {
    let place = tempfile::tempdir_in("/dev/shm")?;
    let output = Command::new(program)
        .args([
            "--headless",
            "--clock",
            "simulated",
            "--speed",
            "max",
            "--for",
            span,
        ])
        .env("XDG_RUNTIME_DIR", place.path())
        .output()?;
    let text = String::from_utf8(output.stdout)?;
    let line = text.lines().find_map(|line| line.strip_suffix(FACTOR));
    let factor = line.and_then(|line| line.rsplit(' ').next()?.parse().ok());
    factor.ok_or_else(|| {
        let told = String::from_utf8_lossy(&output.stderr);
        format!("a run of the hand says no factor:\n{text}\n{told}").into()
    })
}

fn beside_busy_loops(program: &Path, span: &str) -> Result<f64> {
    let over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        for _ in 0..BUSY {
            threads.spawn(|| {
                while !over.load(Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let outcome = factor(program, span);
        over.store(true, Relaxed);
        outcome
    })
}
