//! The answer to `condor ps`: processors and services, and how they are.

use serde::Serialize;

use crate::control::{ClockStatus, Member, SystemStatus};
use crate::view::{Heart, TerminalCounts, View, ViewError};

/// The report that `condor ps --json` prints on a running system: its name and clock, and a row for each processor and
/// each service. [`processors`] makes it.
#[derive(Serialize)]
pub struct ProcessorReport<'s> {
    /// The name of the system.
    pub system: &'s str,
    /// The time since the system was started, in seconds.
    pub uptime: f64,
    /// The process of its supervisor.
    pub pid: u32,
    /// The simulated clock of the system; `None` if the system runs by the real one.
    pub clock: Option<&'s ClockStatus>,
    /// The processors, and after them the services.
    pub processors: Vec<ProcessorRow<'s>>,
}

/// The row of a [`ProcessorReport`] on one processor or service: the state of its program, its heartbeat, the number of
/// its servo loops, and the counts of its terminals.
#[derive(Serialize)]
pub struct ProcessorRow<'s> {
    /// The state of the processor or service, as the supervisor reports it.
    #[serde(flatten)]
    pub member: &'s Member,
    /// Whether it is a service.
    pub is_service: bool,
    /// Whether its program is there, by its mailbox.
    pub heart: Heart,
    /// The number of its servo loops.
    pub loops: usize,
    /// The counts of its terminals.
    pub terminals: Vec<TerminalCounts>,
}

/// Makes the report that `condor ps --json` prints. `status` is the supervisor's report on the system, and `view` reads
/// the heartbeats, the loops and the terminals from the memory of the processors.
///
/// # Errors
/// [`ViewError`] if the memory of a processor cannot be accessed.
pub fn processors<'s>(
    status: &'s SystemStatus,
    view: &View,
) -> Result<ProcessorReport<'s>, ViewError> {
    let count = status.processors.len();
    let mut processors = Vec::new();
    for (place, member) in status.members().enumerate() {
        let number = member.processor();
        processors.push(ProcessorRow {
            member,
            is_service: place >= count,
            heart: view.heart(number)?,
            loops: view.loops(number)?.since(None).len(),
            terminals: view.terminals(number)?,
        });
    }
    Ok(ProcessorReport {
        system: &status.system,
        uptime: status.uptime,
        pid: status.pid,
        clock: status.clock.as_ref(),
        processors,
    })
}
