//! The hand: `condor` with the programs of its processors.
//!
//! Without arguments it brings up the system of `system.toml`.

mod motion;
mod offers;
mod points;
mod summary;
mod texts;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use condor_cli::{AnyError, Application, ProgramFunction};
use condor_host::description::{Files, SystemDescription};
use condor_host::extension::Extension;
use condor_host::robot::{MotionFiles, MotionSender, Robot};
use condor_host::system::SystemDirectory;
use condor_scene::{Ball, HandView};
use qemu_virt_host::HARTS;
use utah_mit_hand::compile::{compile_all, joint_names, read_hand};
use utah_mit_hand::processes;

use offers::Offers;
use texts::Texts;

/// The system that is meant when none is named.
const SYSTEM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/system.toml");

/// The variables that tell of the ball.
const BALL: Ball<'_> = Ball {
    center: ["ball.x", "ball.y", "ball.z"],
    radius_m: "object.radius_m",
    touching: "ball.touching",
};

/// The programs that a processor may run.
struct Hand;

impl Application for Hand {
    fn programs(&self) -> &[(&'static str, ProgramFunction)] {
        &[
            ("master", processes::master),
            ("plant", processes::plant),
            ("replay", processes::replay),
            ("servo", processes::servo),
            ("table", processes::table),
        ]
    }

    fn description(&self) -> Option<PathBuf> {
        Some(SYSTEM.into())
    }

    fn commands(&self) -> &[(&'static str, &'static str, ProgramFunction)] {
        &[("motion", motion::ABOUT, motion::run)]
    }

    fn extensions(&self) -> &[&'static dyn Extension] {
        &[HARTS]
    }

    fn check_robot(&self, robot: &Path) -> Result<(), AnyError> {
        read_hand(robot)?;
        Ok(())
    }

    fn robot(&self, robot: &Path) -> Result<Option<Box<dyn Robot>>, AnyError> {
        let hand = HandView::new(&read_hand(robot)?);
        Ok(Some(Box::new(hand.with_ball(&BALL))))
    }

    fn motions(
        &self,
        robot: &Path,
        description: Option<&SystemDescription>,
    ) -> Result<Option<Box<dyn MotionFiles>>, AnyError> {
        let texts = match description {
            Some(description) => description.files.as_ref().map(texts_of),
            None => Some(Path::new(SYSTEM).with_file_name("")),
        };
        let Some(texts) = texts else { return Ok(None) };
        Ok(Some(Box::new(Texts {
            directory: texts.join("motions"),
            joints: joint_names(&read_hand(robot)?),
        })))
    }

    fn motion_queue(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<Option<Box<dyn MotionSender>>, AnyError> {
        let (Some(hand), Some(files)) = (&description.robot, &description.files) else {
            return Ok(None);
        };
        let joints = joint_names(&read_hand(hand)?);
        Ok(Some(Box::new(Offers::new(directory, &files.root, joints))))
    }

    fn prepare(&self, description: &SystemDescription) -> Result<(), AnyError> {
        let (Some(hand), Some(files)) = (&description.robot, &description.files) else {
            return Ok(());
        };
        offers::clear(&files.root);
        Ok(compile_all(hand, &texts_of(files), &files.root)?)
    }

    fn summarize(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<(), AnyError> {
        summary::of(description, directory)
    }
}

/// Returns the directory with the texts of what is compiled into these files.
fn texts_of(files: &Files) -> PathBuf {
    files.root.with_file_name("")
}

fn main() -> ExitCode {
    condor_cli::main(&Hand)
}
