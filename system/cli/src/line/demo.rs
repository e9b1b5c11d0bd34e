//! `condor demo`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::clock::ClockOptions;
use super::{AnyError, Application, description, ui};
use crate::demo::Demo;
use crate::screen;
use condor_host::description::SystemDescription;

#[derive(Debug, Args)]
pub(super) struct DemoArguments {
    /// The file of the description; by default the one for which this program was built, or else `condor.toml`.
    /// The steps are in the file demo.toml beside it
    file: Option<PathBuf>,
    #[command(flatten)]
    clock: ClockOptions,
    #[command(flatten)]
    tools: ui::Tools,
}

impl DemoArguments {
    pub(super) fn run(&self, application: &dyn Application) -> Result<ExitCode, AnyError> {
        let file = description(self.file.clone(), application);
        let description = match SystemDescription::read(&file, application) {
            Ok(description) => description,
            Err(mistakes) => {
                eprintln!("{mistakes}");
                return Ok(ExitCode::FAILURE);
            }
        };
        let demo = Demo::of(&file, &description)?;
        if !screen::is_possible() {
            return Err(ui::NO_SCREEN.into());
        }
        ui::up(
            &file,
            &description.name,
            None,
            &self.clock.words(),
            &self.tools,
            application,
            Some(demo),
        )
    }
}
