//! The hand: `condor` with the programs of its processors.
//!
//! Without arguments it brings up the system of `system.toml`.

mod summary;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use condor_host::cli::{self, AnyError, Programs};
use condor_host::description::Description;
use condor_host::linux;
use condor_host::system::Directory;
use utah_mit_hand::UtahMit;
use utah_mit_hand::compile::{compile_motions, joint_names};
use utah_mit_hand::master::Master;
use utah_mit_hand::plant::Plant;
use utah_mit_hand::replay::Replay;
use utah_mit_hand::servo::Servo;
use utah_mit_hand::table::Table;

/// The system that is meant when none is named.
const SYSTEM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/system.toml");

/// The programs that a processor may run.
struct Hand;

impl Programs for Hand {
    fn names(&self) -> &[&'static str] {
        &["master", "plant", "replay", "servo", "table"]
    }

    fn run(&self, name: &str, arguments: Vec<String>) -> ExitCode {
        // SAFETY: the loops of these programs neither allocate nor print. They take no lock of the
        // host's: what they share with their backgrounds is in sections of the processor, which keep
        // the signals out.
        unsafe {
            match name {
                "master" => linux::run(&Master, arguments),
                "plant" => linux::run(&Plant, arguments),
                "replay" => linux::run(&Replay, arguments),
                "servo" => linux::run(&Servo, arguments),
                "table" => linux::run(&Table, arguments),
                _ => {
                    eprintln!("utah-mit-hand: there is no program `{name}`");
                    ExitCode::from(2)
                }
            }
        }
    }

    fn description(&self) -> Option<PathBuf> {
        Some(SYSTEM.into())
    }

    fn summarize(&self, description: &Description, directory: &Directory) -> Result<(), AnyError> {
        summary::of(description, directory)
    }
}

/// Compiles the motions that people write to those that the master loads.
fn compile() -> Result<(), AnyError> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let description = Description::read(Path::new(SYSTEM), Hand.names());
    let description = description.map_err(|mistakes| mistakes.to_string())?;
    let file = description.hand.as_ref().ok_or("the system has no hand")?;
    let text = std::fs::read_to_string(file)?;
    let hand = UtahMit::from_toml(&text, &file.to_string_lossy())?;
    let (motions, files) = (package.join("motions"), package.join("files/motions"));
    compile_motions(&motions, &files, &joint_names(&hand))?;
    Ok(())
}

fn main() -> ExitCode {
    // What only looks at a system, or is one of its processors, needs none.
    let verb = std::env::args().nth(1);
    let begins_system = verb.is_none_or(|verb| verb == "up" || verb.starts_with('-'));
    if begins_system && let Err(error) = compile() {
        eprintln!("utah-mit-hand: {error}");
        return ExitCode::FAILURE;
    }
    cli::main(&Hand)
}
