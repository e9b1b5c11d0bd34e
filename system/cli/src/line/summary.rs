//! The summary that a run without user interface prints at its end.

use serde::Serialize;

use super::AnyError;
use crate::counts::{
    self, Row, note_of_loops, table_of_interrupts, table_of_loops, table_of_vectors,
};
use crate::table::{Left, Right, TextTable, or_dash};
use condor_host::control::SystemStatus;
use condor_host::plain::plain_json;
use condor_host::system::SystemDirectory;
use condor_host::view::{BoardInterrupts, LoopRates, VectorCounts, View};

/// The counts that the windows had before the programs were stopped.
#[derive(Default)]
pub(super) struct Summary {
    loops: Vec<Row<LoopRates>>,
    interrupts: Vec<Row<BoardInterrupts>>,
    vectors: Vec<Row<VectorCounts>>,
}

#[derive(Serialize)]
struct Answer<'s> {
    #[serde(flatten)]
    status: &'s SystemStatus,
    loops: &'s [Row<LoopRates>],
    interrupts: &'s [Row<BoardInterrupts>],
    vectors: &'s [Row<VectorCounts>],
}

impl Summary {
    /// Looks at all processors and services.
    ///
    /// # Errors
    /// The windows'.
    pub(super) fn look(
        directory: &SystemDirectory,
        status: &SystemStatus,
    ) -> Result<Self, AnyError> {
        let view = View::open(directory, status.window_bytes)?;
        let mut loops = Vec::new();
        for member in status.members() {
            let rates = view.loops(member.processor())?.overall();
            loops.extend(Row::all(member, rates));
        }
        let vectors = counts::vectors(&view, status.members())?;
        let interrupts = counts::interrupts(&view, &status.processors)?;
        Ok(Self {
            loops,
            interrupts,
            vectors,
        })
    }

    /// Prints it, for people or as JSON, with what the supervisor knows.
    ///
    /// # Errors
    /// Standard output's.
    pub(super) fn print(&self, status: &SystemStatus, json: bool) -> Result<(), AnyError> {
        if json {
            let answer = Answer {
                status,
                loops: &self.loops,
                interrupts: &self.interrupts,
                vectors: &self.vectors,
            };
            println!("{}", plain_json(&answer)?);
            return Ok(());
        }
        println!(
            "\n{}{}{}",
            table_of_loops(&self.loops),
            note_of_loops(&self.loops),
            table_of_interrupts(&self.interrupts)
        );
        println!("{}", table_of_vectors(&self.vectors));
        println!("{}", members(status));
        println!("{} ran for {:.1} s", status.system, status.uptime);
        if let Some(clock) = &status.clock {
            let (seconds, overall) = (clock.seconds, clock.overall);
            println!("simulated time: {seconds:.3} s, {overall:.2} × real time");
        }
        Ok(())
    }
}

fn members(status: &SystemStatus) -> impl core::fmt::Display {
    let mut table = TextTable::new([
        ("number", Right),
        ("name", Left),
        ("state", Left),
        ("restarts", Right),
        ("last exit", Left),
    ]);
    for member in status.members() {
        table.row([
            member.number.to_string(),
            member.name.clone(),
            member.state.to_string(),
            member.restarts.to_string(),
            or_dash(member.last_exit.as_deref()),
        ]);
    }
    table
}
