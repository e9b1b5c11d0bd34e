//! `condor clock`, and the options by which a system is given its clock.

use clap::{Args, Subcommand, ValueEnum};
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use super::AnyError;
use crate::commands::SystemChoice;
use crate::commands::number::duration;
use condor_host::control::{ControlClient, ControlRequest};
use condor_host::description::{ClockKind, ClockSpeed, SystemDescription};
use condor_host::services::terminals::Script;
use condor_host::system;

/// The clock of a system that is started.
#[derive(Debug, Args)]
pub(super) struct ClockOptions {
    /// Runs the processors by this clock instead of that of the description
    #[arg(long, value_enum)]
    clock: Option<Kind>,
    /// Runs a simulated clock at this speed: a multiple of the real time, or `max`
    #[arg(long, value_name = "SPEED")]
    speed: Option<ClockSpeed>,
    /// Types again what was typed in an earlier run, at the same simulated times; FILE is the file `typing` in
    /// the directory of the system of that run
    #[arg(long, value_name = "FILE")]
    typing: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Kind {
    /// The clock of this machine
    Real,
    /// A simulated clock of the system's own, which no other program can delay
    Simulated,
}

impl ClockOptions {
    /// Changes the clock of a description.
    ///
    /// # Errors
    /// A real clock has no speed.
    pub(super) fn apply(&self, clock: &mut ClockKind) -> Result<(), AnyError> {
        *clock = match (self.clock, *clock) {
            (None, clock) => clock,
            (Some(Kind::Real), _) => ClockKind::Real,
            (Some(Kind::Simulated), ClockKind::Real) => ClockKind::Simulated(ClockSpeed::ONE),
            (Some(Kind::Simulated), simulated @ ClockKind::Simulated(_)) => simulated,
        };
        if let Some(new) = self.speed {
            let ClockKind::Simulated(speed) = clock else {
                return Err("--speed needs a simulated clock: a real one has no speed".into());
            };
            *speed = new;
        }
        Ok(())
    }

    /// Returns the characters that are typed in the system, if they are known before.
    ///
    /// # Errors
    /// Returns an error if the record cannot be read or has mistakes, or if the system has a real clock.
    pub(super) fn script(
        &self,
        description: &SystemDescription,
    ) -> Result<Option<Script>, AnyError> {
        let Some(file) = &self.typing else {
            return Ok(None);
        };
        if description.clock == ClockKind::Real {
            return Err(
                "--typing needs a simulated clock, since the typing was recorded in simulated time"
                    .into(),
            );
        }
        let names = description.processors.iter();
        let names: Vec<_> = names.map(|it| it.name.as_str()).collect();
        Ok(Some(Script::read(file, &names)?))
    }

    /// The same as words of a command line.
    pub(super) fn words(&self) -> Vec<OsString> {
        let clock = self.clock.map(|kind| match kind {
            Kind::Real => "--clock=real".into(),
            Kind::Simulated => "--clock=simulated".into(),
        });
        let speed = self.speed.map(|speed| format!("--speed={speed}").into());
        let typing = self.typing.iter();
        let typing = typing.flat_map(|file| ["--typing".into(), file.into()]);
        clock.into_iter().chain(speed).chain(typing).collect()
    }
}

/// Shows the simulated clock of a running system, or changes it.
#[derive(Debug, Args)]
pub(super) struct Clock {
    #[command(subcommand)]
    change: Option<Change>,
    #[command(flatten)]
    which: SystemChoice,
}

#[derive(Debug, Subcommand)]
enum Change {
    /// Pauses the simulated time
    Pause,
    /// Lets this much simulated time pass, such as 2500us or 10s, then pauses it
    Step {
        #[arg(value_parser = duration)]
        time: Duration,
    },
    /// Resumes the simulated time
    Resume,
    /// Sets the speed: a multiple of the real time, or `max`
    Speed { speed: ClockSpeed },
}

impl Clock {
    pub(super) fn run(&self) -> Result<(), AnyError> {
        let mut client = ControlClient::connect(&system::find(self.which.system.as_deref())?)?;
        let request = self.change.as_ref().map(|change| match change {
            Change::Pause => Ok(ControlRequest::Pause {}),
            Change::Step { time } => {
                let ns = u64::try_from(time.as_nanos()).map_err(|_| "the step is too long")?;
                Ok(ControlRequest::Step { ns })
            }
            Change::Resume => Ok(ControlRequest::Resume {}),
            Change::Speed { speed } => Ok(ControlRequest::Speed {
                thousandths: speed.0,
            }),
        });
        if let Some(request) = request {
            let request: Result<ControlRequest, AnyError> = request;
            client.ask(&request?)?;
        }
        match client.status()?.clock {
            Some(clock) => println!("{clock}; it waits for {}", clock.waits_for),
            None => println!("real clock"),
        }
        Ok(())
    }
}
