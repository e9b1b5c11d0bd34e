//! The hand: `condor` with the programs of its processors.
//!
//! Without arguments it brings up the system of `system.toml`.

mod summary;

use std::path::PathBuf;
use std::process::ExitCode;

use condor_host::cli::{self, AnyError, Programs};
use condor_host::description::Description;
use condor_host::system::Directory;
use condor_rt::linux;
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

    fn description(&self) -> Option<PathBuf> {
        Some(SYSTEM.into())
    }

    /// Compiles the motions that people write beside the served directory to those that the master loads.
    fn prepare(&self, description: &Description) -> Result<(), AnyError> {
        let (Some(file), Some(files)) = (&description.hand, &description.files) else {
            return Ok(());
        };
        let motions = files.root.with_file_name("motions");
        if !motions.is_dir() {
            return Ok(());
        }
        let text = std::fs::read_to_string(file)?;
        let hand = UtahMit::from_toml(&text, &file.to_string_lossy())?;
        compile_motions(&motions, &files.root.join("motions"), &joint_names(&hand))?;
        Ok(())
    }

    fn summarize(&self, description: &Description, directory: &Directory) -> Result<(), AnyError> {
        summary::of(description, directory)
    }
}

fn main() -> ExitCode {
    cli::main(&Hand)
}
