//! The shipped hand's controllers with their shipped gains, around a plant of your choice.
//!
//! Without a command the plant is the one of this package; with one it is another program, which
//! answers lines of text as `mujoco_hand.py` beside this file does. The program fails where a goal is
//! not kept.
//!
//! ```text
//! cargo run --release -p condor-hand --example closed_loop
//! cargo run --release -p condor-hand --example closed_loop -- python condor-hand/examples/closed_loop/mujoco_hand.py
//! ```

mod process;
mod rig;
mod trials;

use std::process::ExitCode;

use process::Process;
use rig::{Configuration, Result, Simulated};
use trials::{GOALS, Tuning, strokes, tuned};

/// A trial, by its differences from the shipped configuration.
struct Trial {
    name: &'static str,
    tuning: Option<Tuning>,
}

const TRIALS: [Trial; 2] = [
    Trial {
        name: "the configuration as it is",
        tuning: None,
    },
    // The lag of the shipped velocity filter, 60 Hz, allows some 17 Hz.
    Trial {
        name: "joints at 20 Hz, kp = 1, velocity filter at 100 Hz",
        tuning: Some(Tuning {
            bandwidth_hz: 20.0,
            velocity_cutoff_hz: 100.0,
            kp: 1.0,
        }),
    },
];

fn main() -> ExitCode {
    let command: Vec<String> = std::env::args().skip(1).collect();
    let kept = rig::shipped().and_then(|configuration| {
        let mut kept = true;
        for trial in &TRIALS {
            kept &= run(&configuration, trial, &command)?;
        }
        Ok(kept)
    });
    match kept {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(problem) => {
            eprintln!("closed_loop: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(configuration: &Configuration, trial: &Trial, command: &[String]) -> Result<bool> {
    let configuration = match &trial.tuning {
        Some(tuning) => &tuned(configuration, tuning),
        None => configuration,
    };
    let errors = if command.is_empty() {
        strokes(configuration, Simulated::new(configuration)?)?
    } else {
        strokes(configuration, Process::start(command)?)?
    };
    println!("{}: strokes of 11 to 34 degrees in 0.4 s", trial.name);
    println!("largest of all joints     |  found  at most");
    for (what, found, most) in [
        ("error, degrees", errors.peak_deg, GOALS.peak_deg),
        (
            "error at 0.6 s, degrees",
            errors.settled_deg,
            GOALS.settled_deg,
        ),
        (
            "range at rest, degrees",
            errors.restless_deg,
            GOALS.restless_deg,
        ),
        ("range of a command, N", errors.restless_n, GOALS.restless_n),
        ("below least effort, N", errors.short_n, GOALS.short_n),
    ] {
        println!("{what:26}| {found:7.4}  {most:7.4}");
    }
    let kept = errors.keep(&GOALS);
    println!("{}\n", if kept { "kept" } else { "NOT KEPT" });
    Ok(kept)
}
