//! `condor ps`.

use clap::Args;

use super::running::Running;
use super::{How, print, print_json};
use crate::table::{Left, Right, TextTable, or_dash};
use condor_host::answers::{ProcessorRow, processors};
use condor_host::error::AnyError;

#[derive(Debug, Args)]
pub(crate) struct Ps {
    #[command(flatten)]
    how: How,
}

impl Ps {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let (status, view) = (&running.status, running.view()?);
        let answer = processors(status, &view)?;
        if self.how.json {
            return print_json(&answer);
        }
        print(format_args!(
            "{}: up {:.0} s, process {}\n",
            status.system, status.uptime, status.pid
        ))?;
        if let Some(clock) = &status.clock {
            print(format_args!("{clock}; it waits for {}\n", clock.waits_for))?;
        }
        print(table(&answer.processors))
    }
}

fn table(rows: &[ProcessorRow<'_>]) -> impl core::fmt::Display {
    let mut table = TextTable::new([
        ("number", Right),
        ("name", Left),
        ("kind", Left),
        ("state", Left),
        ("mailbox", Left),
        ("incarnation", Right),
        ("pid", Right),
        ("restarts", Right),
        ("loops", Right),
        ("lost on tty", Right),
        ("last exit", Left),
    ]);
    for row in rows {
        let lost: u32 = row.terminals.iter().map(|terminal| terminal.lost).sum();
        table.row([
            row.member.number.to_string(),
            row.member.name.clone(),
            row.member.kind.clone(),
            row.member.state.to_string(),
            row.heart.presence.to_string(),
            row.heart.incarnation.to_string(),
            or_dash(row.member.pid),
            row.member.restarts.to_string(),
            row.loops.to_string(),
            or_dash((!row.terminals.is_empty()).then_some(lost)),
            or_dash(row.member.last_exit.as_deref()),
        ]);
    }
    table
}
