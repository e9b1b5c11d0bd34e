//! `condor vectors`.

use clap::Args;
use serde::Serialize;

use super::running::{self, Running};
use super::{How, print, print_json};
use crate::error::AnyError;
use crate::table::{Left, Right, Table};
use crate::view::VectorCounts;

#[derive(Debug, Args)]
pub(crate) struct Vectors {
    /// The name or the number of one processor or service
    processor: Option<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
pub(crate) struct Row<'s> {
    pub(crate) processor: &'s str,
    #[serde(flatten)]
    pub(crate) counts: VectorCounts,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    vectors: &'s [Row<'s>],
}

impl Vectors {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let members = match &self.processor {
            Some(text) => vec![running.member(text)?],
            None => running.members().collect(),
        };
        let view = running.view()?;
        let mut rows = Vec::new();
        for member in members {
            let processor = &member.name;
            let vectors = view.vectors(running::number(member))?;
            rows.extend(vectors.into_iter().map(|counts| Row { processor, counts }));
        }
        if self.how.json {
            let system = &running.status.system;
            return print_json(&Answer {
                system,
                vectors: &rows,
            });
        }
        print(table(&rows))
    }
}

pub(crate) fn table(rows: &[Row<'_>]) -> impl core::fmt::Display {
    let mut table = Table::new([
        ("processor", Left),
        ("vector", Right),
        ("name", Left),
        ("handled", Right),
        ("worst µs", Right),
        ("sent", Right),
        ("failed", Right),
    ]);
    for Row { processor, counts } in rows {
        let has_handler = !counts.name.is_empty();
        let handled = |text: String| if has_handler { text } else { "-".into() };
        table.row([
            (*processor).to_owned(),
            counts.vector.to_string(),
            handled(counts.name.clone()),
            handled(counts.handled.to_string()),
            handled(format!("{:.1}", counts.worst_us)),
            counts.sent.to_string(),
            counts.failed.to_string(),
        ]);
    }
    table
}
