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
#[allow(dead_code, reason = "each program takes what it needs")]
mod rig;
mod trials;

use std::process::ExitCode;

use process::Process;
use rig::{Configuration, OfJoints, Result, Simulated};
use trials::{Errors, GOALS, Goals, Tuning, strokes, tuned};

/// What differs from the shipped configuration.
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
        name: "joints at 20 Hz, K_T = 1, velocity filter at 100 Hz",
        tuning: Some(Tuning {
            bandwidth_hz: 20.0,
            velocity_cutoff_hz: 100.0,
            kt: 1.0,
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
    let kept = errors.keep(&GOALS);
    print(configuration, trial, &errors);
    println!("{}\n", if kept { "kept" } else { "NOT KEPT" });
    Ok(kept)
}

fn print(configuration: &Configuration, trial: &Trial, errors: &Errors) {
    let Goals {
        peak_deg,
        settled_deg,
        restless_deg,
        restless_n,
        slack_n,
    } = GOALS;
    println!("{}: strokes of 11 to 34 degrees in 0.4 s", trial.name);
    println!("                    |     error, degrees    |       at rest, range of      least");
    println!("                    |   peak     at 0.6 s   |  joint, deg  command, N  tension, N");
    println!(
        "at most             | {peak_deg:8.3}  {settled_deg:9.4}    | {restless_deg:9.4}  {restless_n:9.4}   >= {:.2}",
        errors.asked_n - slack_n
    );
    for (number, finger) in configuration.fingers.iter().enumerate() {
        for (joint, entry) in finger.joints.iter().enumerate() {
            let of = |all: &OfJoints<f64>| all[number][joint];
            println!(
                "{:20}| {:8.3}  {:9.4}    | {:9.4}  {:9.4}   {:7.3}",
                format!("{} {}", finger.name, entry.name),
                of(&errors.peak_deg),
                of(&errors.settled_deg),
                of(&errors.restless_deg),
                of(&errors.restless_n),
                of(&errors.least_n)
            );
        }
    }
}
