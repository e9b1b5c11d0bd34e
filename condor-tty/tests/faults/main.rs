//! Kills hosts many times under each policy, and accounts for every byte of a terminal.
//!
//! `cargo test --release -p condor-tty --features linux --test faults -- --kills 1000 [--seed N]
//! [--directory DIRECTORY]`
//!
//! Without arguments it is short; those of libtest count for nothing.
//!
//! A processor, in a process of its own, writes known bytes. A host, in another one, shows them in a
//! journal, is killed with SIGKILL at a random instant, and the next one follows. After each kill
//! the journal and the words in shared memory say which bytes were shown, and which of them had
//! been acknowledged. Acknowledged and counted bytes must be what was written, each one at its
//! place; one that is not, and the program fails. The journal is in the temporary directory if none is
//! given. Its disk may be full at times: then the bytes wait in the ring.

mod board;
mod hand;
mod host;
mod judge;
mod scene;

use std::env::VarError;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use condor_mbox::Processor;
use condor_mbox::linux::LinuxSystem;
use interrupt_injector::{argument, seed};

type AnyError = Box<dyn std::error::Error>;

/// A host, a processor, and who watches both.
const N: usize = 3;
const HOST: Processor = Processor(0);
const HAND: Processor = Processor(1);
const WATCHER: Processor = Processor(2);

/// Bytes of the ring.
const CAPACITY: u32 = 4096;

const POLICIES: [&str; 3] = ["block", "drop new", "drop old"];

fn main() -> ExitCode {
    let outcome = part().and_then(|part| match part {
        Some(part) => play(&part).map(|()| true),
        None => direct(),
    });
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("terminal_faults: {error}");
            ExitCode::FAILURE
        }
    }
}

/// In the environment of a child: what it is. A test's arguments are its runner's.
const PART: &str = "CONDOR_TTY_FAULTS_PART";

/// What this process is, if it is a child.
fn part() -> Result<Option<Vec<String>>, AnyError> {
    match std::env::var(PART) {
        Ok(part) => Ok(Some(part.split('\n').map(str::to_owned).collect())),
        Err(VarError::NotPresent) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// This program again, as a child of that part.
fn child(system: &LinuxSystem<N>, part: &[&str]) -> Result<Command, AnyError> {
    let mut command = Command::new(std::env::current_exe()?);
    system.pass_to(&mut command);
    command.env(PART, part.join("\n"));
    Ok(command)
}

/// What a child does, no longer than its parent lives.
fn play(part: &[String]) -> Result<(), AnyError> {
    let parent = rustix::process::getppid();
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL))?;
    if parent != rustix::process::getppid() {
        return Err("the parent has ended".into());
    }
    let words: Vec<&str> = part.iter().map(String::as_str).collect();
    match words[..] {
        ["hand", policy, seed] => hand::play(policy, Random(seed.parse()?)),
        ["host", journal] => host::play(journal.as_ref()),
        _ => Err(format!("nobody plays {part:?}").into()),
    }
}

struct Options {
    kills: u32,
    seed: u64,
    directory: PathBuf,
}

impl Options {
    fn of_arguments() -> Result<Self, AnyError> {
        Ok(Self {
            kills: argument("--kills", 20)?,
            seed: seed()?,
            directory: argument("--directory", std::env::temp_dir())?,
        })
    }
}

/// What the parent does; false if something was wrong.
fn direct() -> Result<bool, AnyError> {
    let options = Options::of_arguments()?;
    let directory = tempfile::tempdir_in(&options.directory)?;
    let journal = directory.path().join("journal");
    let mut discrepancies = 0;
    for policy in POLICIES {
        let random = Random(options.seed | 1);
        let account = scene::play(policy, options.kills, random, &journal)?;
        println!("{policy:>8}: {account}");
        discrepancies += account.discrepancies();
    }
    println!("{discrepancies} discrepancies");
    Ok(discrepancies == 0)
}

/// The byte that is at a position of the ring.
fn byte_at(position: u32) -> u8 {
    position.wrapping_mul(0x9e37_79b1).to_be_bytes()[0]
}

/// Marsaglia's xorshift, 64 bits; its state is not 0.
struct Random(u64);

impl Random {
    fn below(&mut self, count: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % count
    }
}
