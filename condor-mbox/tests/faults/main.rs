//! Kills and stops a process many times while others talk to it.
//!
//! `cargo test --release -p condor-mbox --features linux --test faults -- --kills 1000`
//!
//! Without arguments it is short; those of libtest count for nothing.
//!
//! Two survivors call a victim, are called by it, send it messages without reply and poll tickets;
//! every word is checked. The victim is killed with SIGKILL where it hurts, and starts again;
//! it is stopped past every deadline, and goes on; then all processes of a system are killed and
//! begin again, and at last the memory of one is truncated. Nothing is ever cleaned up by hand. `--rounds`
//! is how often all are killed; `/dev/shm`, where their files are, may be full at times.
//! One wrong or lost reply, or one error that does not say what was the case, and the program fails.

mod board;
mod director;
mod everyone;
mod judge;
mod process;
mod random;
mod record;
mod report;
mod survivor;
mod talk;
mod truncation;
mod victim;

use std::process::ExitCode;
use std::time::Instant;

use condor_mbox::linux::LinuxSystem;
use interrupt_injector::{argument, seed};

use board::{Board, Director, USER_BYTES};
use director::Scene;
use process::Process;
use report::Report;
use talk::{N, SURVIVORS};

type AnyError = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    match process::part().and_then(|part| match part {
        Some(part) => play(&part).map(|()| true),
        None => direct(),
    }) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("faults: {error}");
            ExitCode::FAILURE
        }
    }
}

/// What a child does.
fn play(part: &[String]) -> Result<(), AnyError> {
    let words: Vec<&str> = part.iter().map(String::as_str).collect();
    match words[..] {
        ["victim", number] => victim::play(number.parse()?),
        ["survivor", seed] => {
            let claim = LinuxSystem::<N>::inherited()?.claim(SURVIVORS[1])?;
            survivor::play(&claim, seed.parse()?)
        }
        ["member", number] => everyone::play(number.parse()?),
        _ => Err(format!("nobody plays {part:?}").into()),
    }
}

/// How much is to be done.
struct Options {
    kills: u32,
    stops: u32,
    rounds: u32,
    seed: u64,
}

impl Options {
    fn of_arguments() -> Result<Self, AnyError> {
        Ok(Self {
            kills: argument("--kills", 24)?,
            stops: argument("--stops", 6)?,
            rounds: argument("--rounds", 3)?,
            seed: seed()?,
        })
    }
}

/// What the parent does; false if something was wrong.
fn direct() -> Result<bool, AnyError> {
    let options = Options::of_arguments()?;
    let begun = Instant::now();
    let mut report = with_survivors(&options)?;
    report.everyone = everyone::kill_all(options.rounds, options.seed)?;
    report.truncation = truncation::truncate()?;
    report.print(begun.elapsed());
    Ok(report.faults() == 0)
}

/// Kills and stops the victim of a family.
fn with_survivors(options: &Options) -> Result<Report, AnyError> {
    let system = LinuxSystem::<N>::family(USER_BYTES)?;
    let claim = system.claim(SURVIVORS[0])?;
    let board = Board::new(&claim);
    let mut other = Process::start(&format!("survivor {}", options.seed ^ 1), |command| {
        system.pass_to(command);
    })?;
    let mut scene = Scene::new(&system, &board, &claim, options.seed);
    let ended = std::thread::scope(|threads| {
        let (own, seed) = (&claim, options.seed ^ 2);
        let survivor = threads.spawn(move || survivor::play(own, seed).map_err(|e| e.to_string()));
        let directed = scene
            .kill(options.kills)
            .and_then(|()| scene.stop(options.stops));
        board.direct(Director::Over, 1);
        let ended = survivor
            .join()
            .map_err(|_| "a survivor panicked".to_owned());
        directed.and_then(|()| Ok(ended??))
    });
    // A survivor that waits for the other one's death is no survivor.
    let others_end = other.wait()?;
    let mut report = Report::new(&board, scene);
    if let Err(error) = ended {
        report.broken(&error.to_string());
    }
    if !others_end.success() {
        report.broken(&format!("the other survivor ended with {others_end}"));
    }
    Ok(report)
}
