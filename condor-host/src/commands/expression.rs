//! `condor print`: variables of a running program, by their names in its debug information.

use std::time::{Duration, Instant};

use clap::Args;
use condor_debug::names::{Names, Value};
use serde::Serialize;

use super::debug::{debuggee, program};
use super::number::duration;
use super::running::Running;
use super::{How, print, print_json};
use crate::application::Application;
use crate::error::{AnyError, FileError};

#[derive(Debug, Args)]
pub(crate) struct Print {
    /// The name or the number of the processor
    processor: String,
    /// Static variables or parts of them, such as 'SERVO.joints[2].gain'
    #[arg(required = true)]
    expressions: Vec<String>,
    /// Prints them again and again, after this time, such as 10ms, until Ctrl-C
    #[arg(long, value_name = "TIME", value_parser = duration)]
    every: Option<Duration>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Shown<'s> {
    expression: &'s str,
    value: String,
}

impl Print {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let member = running.processor(&self.processor)?;
        let view = running.view()?;
        let Some(debuggee) = debuggee(&running, member, &view, application)? else {
            let text = "is a process of this machine; `condor gdb` shows its variables";
            return Err(format!("{} {text}", member.name).into());
        };
        let path = program(&running, member);
        let file = std::fs::read(&path).map_err(FileError::at("read", &path))?;
        let names = Names::read(&file).map_err(|error| format!("{}: {error}", path.display()))?;
        let values = self.expressions.iter().map(|text| names.find(text));
        let values: Vec<Value<'_, '_>> = values.collect::<Result<_, _>>()?;
        let mut next = Instant::now();
        loop {
            for (expression, value) in self.expressions.iter().zip(&values) {
                let address = value.address.wrapping_add(debuggee.bias);
                let bytes = debuggee.read(address, value.bytes);
                let bytes = bytes.ok_or_else(|| format!("{expression} is in no memory of it"))?;
                let value = value.text(&bytes);
                if self.how.json {
                    print_json(&Shown { expression, value })?;
                } else {
                    print(format_args!("{expression} = {value}\n"))?;
                }
            }
            let Some(time) = self.every else {
                return Ok(());
            };
            // Reads that came late do not delay those behind them.
            next += time;
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            running.check()?;
        }
    }
}
