//! What a run without user interface says at its end.

use serde::Serialize;

use super::AnyError;
use crate::commands::{running, top, vectors};
use crate::control::Status;
use crate::plain::plain_json;
use crate::system::SystemDirectory;
use crate::table::{Left, Right, Table, or_dash};
use crate::view::{LoopRates, VectorCounts, View};

/// What the windows said before the programs were stopped.
#[derive(Default)]
pub(super) struct Summary {
    loops: Vec<(String, LoopRates)>,
    vectors: Vec<(String, VectorCounts)>,
}

#[derive(Serialize)]
struct Answer<'s> {
    #[serde(flatten)]
    status: &'s Status,
    loops: Vec<top::Row<'s>>,
    vectors: Vec<vectors::Row<'s>>,
}

impl Summary {
    /// Looks at all processors and services.
    ///
    /// # Errors
    /// The windows'.
    pub(super) fn look(directory: &SystemDirectory, status: &Status) -> Result<Self, AnyError> {
        let view = View::open(&directory.system(status.window_bytes)?)?;
        let mut summary = Self::default();
        for member in status.processors.iter().chain(&status.services) {
            let number = running::number(member);
            for rates in view.loops(number)?.overall() {
                summary.loops.push((member.name.clone(), rates));
            }
            for counts in view.vectors(number)? {
                summary.vectors.push((member.name.clone(), counts));
            }
        }
        Ok(summary)
    }

    /// Prints it, for people or as JSON, with what the supervisor knows.
    ///
    /// # Errors
    /// Standard output's.
    pub(super) fn print(&self, status: &Status, json: bool) -> Result<(), AnyError> {
        let loops = self.loops.iter().map(|(processor, rates)| top::Row {
            processor,
            rates: rates.clone(),
        });
        let vectors = self.vectors.iter().map(|(processor, counts)| vectors::Row {
            processor,
            counts: counts.clone(),
        });
        let answer = Answer {
            status,
            loops: loops.collect(),
            vectors: vectors.collect(),
        };
        if json {
            println!("{}", plain_json(&answer)?);
            return Ok(());
        }
        println!("\n{}", top::table(&answer.loops));
        println!("{}", vectors::table(&answer.vectors));
        println!("{}", members(status));
        println!("{} ran for {:.1} s", status.system, status.uptime);
        Ok(())
    }
}

fn members(status: &Status) -> impl core::fmt::Display {
    let mut table = Table::new([
        ("number", Right),
        ("name", Left),
        ("state", Left),
        ("restarts", Right),
        ("last exit", Left),
    ]);
    for member in status.processors.iter().chain(&status.services) {
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
