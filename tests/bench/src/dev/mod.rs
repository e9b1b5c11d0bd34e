//! `dev`: what a write to a device costs beside the driver's own instructions.
//!
//! Sixteen bits go to the same register of the same driver on the same bus, which is plain memory: by the
//! driver called directly, and by the descriptor; by the driver's own method, and by that of the typed
//! device. Instructions are counted by callgrind, from the first of the function that goes that way to its
//! return; they are the same every time, so there are no rounds and their intervals have no width.

mod boards;
mod paths;

use crate::Result;
use crate::callgrind;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;

pub(crate) use paths::go;

/// Counts all paths.
///
/// # Errors
/// Returns an error if valgrind is missing or fails.
pub(crate) fn run(_: &Options) -> Result<Report> {
    let (text, [direct, fd, direct16, typed]) = callgrind::table(
        "one call",
        [
            ("direct", "driver, called directly"),
            ("fd", "switch, by descriptor"),
            ("direct16", "16-bit call, directly"),
            ("typed", "16-bit call of the typed device"),
        ],
    )?;
    let most = |name, value, limit| Goal::most(name, Estimate::exactly(value), limit);
    let goals = vec![
        most("fd_over_direct", fd - direct, 25.0),
        most("typed_over_direct", typed - direct16, 0.0),
    ];
    Ok(Report { text, goals })
}
