//! `condor ps`.

use clap::Args;
use serde::Serialize;

use super::running::Running;
use super::{How, print, print_json};
use crate::control::{ClockStatus, Member, Status};
use crate::error::AnyError;
use crate::table::{Left, Right, Table, or_dash};
use crate::view::{Heart, TerminalCounts, View};

#[derive(Debug, Args)]
pub(crate) struct Ps {
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Row<'s> {
    #[serde(flatten)]
    member: &'s Member,
    is_service: bool,
    heart: Heart,
    loops: usize,
    terminals: Vec<TerminalCounts>,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    uptime: f64,
    pid: u32,
    clock: Option<&'s ClockStatus>,
    processors: Vec<Row<'s>>,
}

impl Ps {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let (status, view) = (&running.status, running.view()?);
        if self.how.json {
            return print_json(&answer(status, &view)?);
        }
        let rows = rows(status, &view)?;
        print(format_args!(
            "{}: up {:.0} s, process {}\n",
            status.system, status.uptime, status.pid
        ))?;
        if let Some(clock) = &status.clock {
            print(format_args!("{clock}; it waits for {}\n", clock.waits_for))?;
        }
        print(table(&rows))
    }
}

/// Returns what `ps --json` prints.
///
/// # Errors
/// [`ViewError`](crate::view::ViewError) if the memory of a processor cannot be accessed.
pub fn answer<'s>(status: &'s Status, view: &View) -> Result<impl Serialize + use<'s>, AnyError> {
    Ok(Answer {
        system: &status.system,
        uptime: status.uptime,
        pid: status.pid,
        clock: status.clock.as_ref(),
        processors: rows(status, view)?,
    })
}

fn rows<'s>(status: &'s Status, view: &View) -> Result<Vec<Row<'s>>, AnyError> {
    let count = status.processors.len();
    let mut rows = Vec::new();
    for (place, member) in status.members().enumerate() {
        let number = member.processor();
        rows.push(Row {
            member,
            is_service: place >= count,
            heart: view.heart(number)?,
            loops: view.loops(number)?.since(None).len(),
            terminals: view.terminals(number)?,
        });
    }
    Ok(rows)
}

fn table(rows: &[Row<'_>]) -> impl core::fmt::Display {
    let mut table = Table::new([
        ("number", Right),
        ("name", Left),
        ("kind", Left),
        ("state", Left),
        ("mailbox", Left),
        ("life", Right),
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
            row.heart.life.to_string(),
            or_dash(row.member.pid),
            row.member.restarts.to_string(),
            row.loops.to_string(),
            or_dash((!row.terminals.is_empty()).then_some(lost)),
            or_dash(row.member.last_exit.as_deref()),
        ]);
    }
    table
}
