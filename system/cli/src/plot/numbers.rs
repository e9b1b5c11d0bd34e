//! [`Numbers`]: curves of expressions, which are read of programs that run.

use std::time::{Duration, Instant};

use super::curve::{Sample, Variable};
use crate::peek::{NumberAt, Peek};
use condor_host::control::{ControlClient, SystemStatus};
use condor_host::error::AnyError;
use condor_host::extension::Extension;
use condor_host::system::SystemDirectory;
use condor_host::view::View;

/// The time between two samples, and between two looks for programs that were restarted.
const PERIOD: Duration = Duration::from_millis(10);
const LOOK: Duration = Duration::from_millis(500);

/// The numbers of a plot, in the order in which they were found.
pub(super) struct Numbers<'v> {
    extensions: &'v [&'static dyn Extension],
    directory: &'v SystemDirectory,
    status: &'v SystemStatus,
    view: &'v View,
    /// The programs that were asked for, by the numbers of their processors.
    programs: Vec<(u8, Peek)>,
    /// Each with the place of its program, its place in that program if it has it, and its expression.
    found: Vec<(usize, Option<NumberAt>, String)>,
    next: Instant,
    next_look: Instant,
}

impl<'v> Numbers<'v> {
    pub(super) fn new(
        extensions: &'v [&'static dyn Extension],
        directory: &'v SystemDirectory,
        status: &'v SystemStatus,
        view: &'v View,
    ) -> Self {
        Self {
            extensions,
            directory,
            status,
            view,
            programs: Vec::new(),
            found: Vec::new(),
            next: Instant::now(),
            next_look: Instant::now() + LOOK,
        }
    }

    /// Finds the number of a name such as `servo-a:SERVO.joints[2].gain`; `None` if the name does not begin with
    /// a processor.
    pub(super) fn find(&mut self, name: &str) -> Option<Result<Variable, String>> {
        let (processor, expression) = name.split_once(':')?;
        let member = self.status.processor(processor).ok()?;
        let mut known = self.programs.iter();
        let known = known.position(|(it, _)| *it == member.number);
        let place = known.unwrap_or(self.programs.len());
        if known.is_none() {
            let (extensions, directory) = (self.extensions, self.directory);
            match Peek::open(extensions, directory, self.status, member, self.view) {
                Ok(peek) => self.programs.push((member.number, peek)),
                Err(error) => return Some(Err(error.to_string())),
            }
        }
        let (_, peek) = self.programs.get(place)?;
        Some(match peek.number(expression) {
            Ok(number) => {
                self.found.push((place, Some(number), expression.into()));
                Ok(Variable {
                    processor: member.name.clone(),
                    owner: String::new(),
                    name: expression.into(),
                    unit: String::new(),
                    labels: Vec::new(),
                })
            }
            Err(error) => Err(error.to_string()),
        })
    }

    /// A sample of each, if it is time for one; the first has the curve `first`.
    pub(super) fn read(&mut self, first: usize, at_ns: u64) -> Vec<Sample> {
        let now = Instant::now();
        if self.found.is_empty() || now < self.next {
            return Vec::new();
        }
        self.next = now + PERIOD;
        if now >= self.next_look {
            self.next_look = now + LOOK;
            for place in 0..self.programs.len() {
                // As long as a program does not run again, it has no numbers.
                let _ = self.follow_restart(place);
            }
        }
        let samples = self
            .found
            .iter()
            .zip(first..)
            .map(|((place, number, _), curve)| {
                let program = self.programs.get(*place);
                let value = program.zip(*number);
                let value = value.map_or(f64::NAN, |((_, peek), number)| peek.value(number));
                Sample {
                    curve,
                    at_ns,
                    value,
                }
            });
        samples.collect()
    }

    /// Opens a program of a process again after its end, perhaps another one.
    fn follow_restart(&mut self, place: usize) -> Result<(), AnyError> {
        let Some((number, peek)) = self.programs.get_mut(place) else {
            return Ok(());
        };
        if peek.is_there() {
            return Ok(());
        }
        let status = ControlClient::connect(self.directory)?.status()?;
        let member = status.processor(&number.to_string())?;
        *peek = Peek::open(self.extensions, self.directory, &status, member, self.view)?;
        for (_, at, expression) in self.found.iter_mut().filter(|it| it.0 == place) {
            *at = peek.number(expression).ok();
        }
        Ok(())
    }
}
