//! What a run without user interface says at its end.

use serde::Serialize;

use super::AnyError;
use crate::commands::{top, vectors};
use crate::control::{Member, Status};
use crate::description::Description;
use crate::numbers::{FILES, TERMINALS};
use crate::system::Directory;
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
    pub(super) fn look(description: &Description, directory: &Directory) -> Result<Self, AnyError> {
        let view = View::open(&directory.system(description.window_bytes)?)?;
        let mut summary = Self::default();
        let processors = description.processors.iter();
        let processors = processors.map(|it| (it.name.as_str(), condor_mbox::Processor(it.number)));
        let services = [("files", FILES), ("terminals", TERMINALS)];
        for (name, number) in processors.chain(services) {
            for rates in view.loops(number)?.overall() {
                summary.loops.push((name.into(), rates));
            }
            for counts in view.vectors(number)? {
                summary.vectors.push((name.into(), counts));
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
            println!("{}", serde_json::to_string(&answer)?);
            return Ok(());
        }
        println!("\n{}", top::table(&answer.loops));
        println!("{}", vectors::table(&answer.vectors));
        print_members(status);
        Ok(())
    }
}

fn print_members(status: &Status) {
    println!("{} ran for {:.1} s", status.system, status.uptime);
    println!(
        "{:>6}  {:<16} {:<10} {:>8}  last exit",
        "number", "name", "state", "restarts"
    );
    for member in status.services.iter().chain(&status.processors) {
        let Member {
            number,
            name,
            state,
            restarts,
            last_exit,
            ..
        } = member;
        let last_exit = last_exit.as_deref().unwrap_or("-");
        println!("{number:>6}  {name:<16} {state:<10} {restarts:>8}  {last_exit}");
    }
}
