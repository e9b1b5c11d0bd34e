//! `condor top`.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::number::duration;
use super::running::Running;
use super::{How, print, print_json};
use crate::counts::{
    self, LastLook, Row, beyond_declared, note_of_loops, table_of_interrupts, table_of_loops,
    table_of_percentiles,
};
use crate::screen;
use condor_host::application::Application;
use condor_host::control::ClockStatus;
use condor_host::description::{ProcessorEntry, SystemDescription};
use condor_host::error::AnyError;
use condor_host::plain::plain_lines;
use condor_host::signals;
use condor_host::view::{BoardInterrupts, LoopRates};

#[derive(Debug, Args)]
pub(crate) struct Top {
    /// Shows the loops once and ends
    #[arg(long)]
    once: bool,
    /// The time between two updates, such as 500ms or 2s
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = duration)]
    every: Duration,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    clock: Option<&'s ClockStatus>,
    loops: &'s [Row<LoopRates>],
    interrupts: &'s [Row<BoardInterrupts>],
    beyond_declared: &'s [String],
}

impl Top {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        // A description that somebody is changing declares nothing.
        let described = SystemDescription::read(&running.status.file, application);
        let described = described.map_or_else(|_| Vec::new(), |it| it.processors);
        let view = running.view()?;
        let end = signals::flag()?;
        let repaint = !self.once && !self.how.json && screen::can_repaint();
        let (mut last, processors) = (LastLook::default(), &running.status.processors);
        last.since(&view, processors)?;
        loop {
            let until = Instant::now() + self.every;
            while Instant::now() < until {
                if end.load(Ordering::Relaxed) {
                    return Ok(());
                }
                let left = until.saturating_duration_since(Instant::now());
                std::thread::sleep(left.min(Duration::from_millis(50)));
            }
            running.check()?;
            let clock = running.clock()?;
            let loops = last.since(&view, processors)?;
            let interrupts = counts::interrupts(&view, processors)?;
            let counts = (&loops[..], &interrupts[..]);
            self.show(&running, clock.as_ref(), counts, &described, repaint)?;
            if self.once {
                return Ok(());
            }
        }
    }

    fn show(
        &self,
        running: &Running,
        clock: Option<&ClockStatus>,
        (loops, interrupts): (&[Row<LoopRates>], &[Row<BoardInterrupts>]),
        described: &[ProcessorEntry],
        repaint: bool,
    ) -> Result<(), AnyError> {
        let system = &running.status.system;
        let beyond = beyond_declared(loops, described);
        if self.how.json {
            return print_json(&Answer {
                system,
                clock,
                loops,
                interrupts,
                beyond_declared: &beyond,
            });
        }
        let clear = if repaint { "\x1b[H\x1b[J" } else { "" };
        let more = if self.once || repaint { "" } else { "\n" };
        let clock = clock.map_or_else(String::new, |clock| format!("{clock}\n"));
        let (table, note) = (table_of_loops(loops), note_of_loops(loops));
        let percentiles = table_of_percentiles(loops);
        let beyond = beyond.iter().map(|text| format!("{}\n", plain_lines(text)));
        let (beyond, interrupts) = (beyond.collect::<String>(), table_of_interrupts(interrupts));
        print(format_args!(
            "{clear}{clock}{table}{note}{beyond}{percentiles}{interrupts}{more}"
        ))
    }
}
