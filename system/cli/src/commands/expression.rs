//! `condor print`: variables of a running program, by their names in its debug information.

use std::time::{Duration, Instant};

use clap::Args;
use condor_debug::names::{NamedValue, Names};
use serde::Serialize;

use super::number::duration;
use super::running::Running;
use super::{How, print, print_json};
use crate::peek::Peek;
use condor_host::application::Application;
use condor_host::error::AnyError;

#[derive(Debug, Args)]
pub(crate) struct Print {
    /// The name or the number of the processor
    processor: String,
    /// Static variables or parts of them, such as 'SERVO.joints[2].gain'; 'SERVO.joints[2].gain=1.5' sets a
    /// number first
    #[arg(required = true)]
    expressions: Vec<String>,
    /// Prints the values again each time that this time has passed, such as 10ms, until Ctrl-C
    #[arg(long, value_name = "TIME", value_parser = duration)]
    every: Option<Duration>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct PrintedValue<'s> {
    expression: &'s str,
    value: String,
}

/// The request of an argument.
struct ParsedArgument<'a, 'n, 'f> {
    expression: &'a str,
    value: NamedValue<'n, 'f>,
    /// The bytes to be written.
    new: Option<Vec<u8>>,
}

impl<'a, 'n, 'f> ParsedArgument<'a, 'n, 'f> {
    fn parse(names: &'n Names<'f>, argument: &'a str) -> Result<Self, AnyError> {
        let parts = argument.split_once('=');
        let expression = parts.map_or(argument, |(expression, _)| expression.trim());
        let value = names.find(expression)?;
        let new = parts.map(|(_, text)| {
            let number = value.number().ok_or_else(|| {
                format!("cannot set `{expression}`: it is not a number that occupies whole bytes; use GDB for it")
            })?;
            let bytes = number.bytes(text.trim());
            bytes.ok_or_else(|| format!("`{expression}` cannot be `{}`", text.trim()))
        });
        Ok(Self {
            new: new.transpose()?,
            expression,
            value,
        })
    }
}

impl Print {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let member = running.processor(&self.processor)?;
        let (view, extensions) = (running.view()?, application.extensions());
        let peek = Peek::open(
            extensions,
            &running.directory,
            &running.status,
            member,
            &view,
        )?;
        let names = peek.names()?;
        let requests = self
            .expressions
            .iter()
            .map(|text| ParsedArgument::parse(&names, text));
        let requests: Vec<ParsedArgument<'_, '_, '_>> = requests.collect::<Result<_, _>>()?;
        for ParsedArgument {
            expression,
            value,
            new,
        } in &requests
        {
            if let Some(bytes) = new {
                let written = peek.write(value.address, bytes);
                written
                    .ok_or_else(|| format!("{expression} is not in the memory of the processor"))?;
            }
        }
        let mut next = Instant::now();
        loop {
            for ParsedArgument {
                expression, value, ..
            } in &requests
            {
                let bytes = peek.read(value.address, value.bytes);
                let bytes = bytes.ok_or_else(|| {
                    if peek.is_there() {
                        format!("{expression} is not in the memory of the processor")
                    } else {
                        format!(
                            "the program of {} has ended; run the command again",
                            member.name
                        )
                    }
                })?;
                let value = value.text(&bytes);
                if self.how.json {
                    print_json(&PrintedValue { expression, value })?;
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
