//! The hand at work while its services and its user interface are killed again and again.
//!
//! `cargo run --release -p utah-mit-hand --example kills -- --for 60s [--seed N]`
//!
//! Runs the hand with two programs that count all they do, first undisturbed, then for the same time
//! with a `kill -9` every few hundred milliseconds, at random to the file service, the terminal service
//! or the user interface. Fails if in either run a message, a byte that was written or typed, a line of
//! a file or a motion was lost or doubled, or if a processor did not live on. Beside each other it
//! prints the releases that the loops have skipped, which depend on what else the machine does.

mod drive;
mod killer;
mod system;
mod teller;

use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use condor_robot::program::RobotApplication;
use condor_rt::linux;
use utah_mit_boards::robot::PROCESSES;

use drive::Seen;
use teller::Teller;

const USAGE: &str = "usage: kills [--for SECONDSs] [--seed N]";

/// The hand, with the program that counts what it does.
const HAND: RobotApplication = RobotApplication::new("system.toml", &PROCESSES)
    .with_programs(&[("teller", |arguments| linux::run(&Teller, arguments))]);

fn main() -> ExitCode {
    // The supervisor starts this program again, for its processors.
    let word = std::env::args().nth(1);
    if word.is_some_and(|word| !word.starts_with('-')) {
        return HAND.run();
    }
    if std::env::args().any(|it| it == "--help" || it == "-h") {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    let Some((length, seed)) = options(std::env::args().skip(1)) else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    println!("{length:?} undisturbed, then {length:?} with kills, seed {seed}");
    let outcome = drive::run(length, None).and_then(|quiet| {
        println!("undisturbed: {}", sum(&quiet));
        let killed = drive::run(length, Some(seed))?;
        println!("with kills:  {}", sum(&killed));
        Ok((quiet, killed))
    });
    let (quiet, killed) = match outcome {
        Ok(both) => both,
        Err(error) => {
            eprintln!("kills: {error}");
            return ExitCode::FAILURE;
        }
    };
    print(&quiet, &killed);
    for (run, seen) in [("undisturbed", &quiet), ("with kills", &killed)] {
        for wrong in &seen.wrong {
            println!("WRONG, {run}: {wrong}");
        }
    }
    if quiet.wrong.is_empty() && killed.wrong.is_empty() {
        println!("nothing was lost or doubled, and every processor has lived on");
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// The length of a run, and what chance begins with.
fn options(mut arguments: impl Iterator<Item = String>) -> Option<(Duration, u64)> {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let mut seed = now.map_or(0, |now| u64::from(now.subsec_nanos()));
    let mut length = Duration::from_secs(60);
    while let Some(argument) = arguments.next() {
        let value = arguments.next()?;
        match argument.as_str() {
            "--for" => length = Duration::from_secs(value.strip_suffix('s')?.parse().ok()?),
            "--seed" => seed = value.parse().ok()?,
            _ => return None,
        }
    }
    Some((length, seed))
}

/// Returns the results of a run as text.
fn sum(seen: &Seen) -> String {
    let Seen {
        kills,
        typed,
        lines,
        messages,
        appended,
        replaced,
        saved,
        motions,
        faults,
        drawn,
        ..
    } = seen;
    format!(
        "{} kills of the user interface, {} of the terminal service, {} of the file service\n  \
         {lines} lines written, {typed} lines typed at each of 2 terminals, {messages} messages,\n  \
         {appended} lines appended, {replaced} files replaced, {saved} sequences saved, {motions} motions \
         done, {faults} faults of fingers, {} KiB drawn",
        kills.screen,
        kills.terminals,
        kills.files,
        drawn / 1024
    )
}

fn print(quiet: &Seen, killed: &Seen) {
    println!(
        "\n{:<10} {:<14} {:>9} {:>7} {:>12} {:>9} {:>7} {:>12}",
        "", "undisturbed:", "runs", "skips", "worst late", "kills:", "skips", "worst late"
    );
    for ((name, a), (_, b)) in quiet.counts.iter().zip(&killed.counts) {
        println!(
            "{name:<10} {:<14} {:>9} {:>7} {:>9.0} us {:>9} {:>7} {:>9.0} us",
            a.loop_name, a.runs, a.overruns, a.worst_us, b.runs, b.overruns, b.worst_us
        );
    }
    println!();
}
