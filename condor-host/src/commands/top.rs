//! `condor top`.

use std::collections::HashMap;
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use signal_hook::consts::{SIGINT, SIGTERM};

use super::number::duration;
use super::running::{self, Running};
use super::{How, print, print_json};
use crate::error::AnyError;
use crate::table::{Left, Right, Table, or_dash};
use crate::view::{LoopRates, LoopSample, View};

#[derive(Debug, Args)]
pub(crate) struct Top {
    /// Shows them once
    #[arg(long)]
    once: bool,
    /// The time between two looks
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = duration)]
    every: Duration,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
pub(crate) struct Row<'s> {
    pub(crate) processor: &'s str,
    #[serde(flatten)]
    pub(crate) rates: LoopRates,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    loops: &'s [Row<'s>],
}

type Samples = HashMap<u8, LoopSample>;

/// Set by Ctrl-C.
pub(crate) fn interrupted() -> std::io::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, flag.clone())?;
    }
    Ok(flag)
}

impl Top {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let view = running.view()?;
        let end = interrupted()?;
        let repaint = !self.once && !self.how.json && std::io::stdout().is_terminal();
        let mut before = sample(&running, &view)?;
        loop {
            let until = Instant::now() + self.every;
            while Instant::now() < until {
                if end.load(Ordering::Relaxed) {
                    return Ok(());
                }
                let left = until.saturating_duration_since(Instant::now());
                std::thread::sleep(left.min(Duration::from_millis(50)));
            }
            if !running.directory.is_running() {
                return Err(format!("the system `{}` has ended", running.status.system).into());
            }
            let now = sample(&running, &view)?;
            self.show(&running, &now, &before, repaint)?;
            if self.once {
                return Ok(());
            }
            before = now;
        }
    }

    fn show(
        &self,
        running: &Running,
        now: &Samples,
        before: &Samples,
        repaint: bool,
    ) -> Result<(), AnyError> {
        let mut rows = Vec::new();
        for member in &running.status.processors {
            let Some(sample) = now.get(&member.number) else {
                continue;
            };
            let rates = sample.since(before.get(&member.number));
            let processor = &member.name;
            rows.extend(rates.into_iter().map(|rates| Row { processor, rates }));
        }
        let system = &running.status.system;
        if self.how.json {
            return print_json(&Answer {
                system,
                loops: &rows,
            });
        }
        let clear = if repaint { "\x1b[H\x1b[J" } else { "" };
        let more = if self.once || repaint { "" } else { "\n" };
        print(format_args!("{clear}{}{more}", table(&rows)))
    }
}

fn sample(running: &Running, view: &View) -> Result<Samples, AnyError> {
    let mut samples = Samples::new();
    for member in &running.status.processors {
        samples.insert(member.number, view.loops(running::number(member))?);
    }
    Ok(samples)
}

pub(crate) fn table(rows: &[Row<'_>]) -> impl core::fmt::Display {
    let mut table = Table::new([
        ("processor", Left),
        ("loop", Left),
        ("Hz", Right),
        ("reached", Right),
        ("run µs", Right),
        ("worst", Right),
        ("use %", Right),
        ("late µs", Right),
        ("overruns", Right),
        ("", Left),
    ]);
    for Row { processor, rates } in rows {
        table.row([
            (*processor).to_owned(),
            rates.name.clone(),
            rates.rate_hz.to_string(),
            or_dash(rates.reached_hz.map(|rate| format!("{rate:.1}"))),
            format!("{:.1}", rates.run_us),
            format!("{:.1}", rates.worst_run_us),
            or_dash(rates.utilisation.map(|part| format!("{:.2}", 100.0 * part))),
            format!("{:.1}", rates.worst_lateness_us),
            rates.overruns.to_string(),
            state(rates).into(),
        ]);
    }
    table
}

const fn state(rates: &LoopRates) -> &'static str {
    if rates.faulted {
        "faulted"
    } else if rates.enabled {
        ""
    } else {
        "disabled"
    }
}
