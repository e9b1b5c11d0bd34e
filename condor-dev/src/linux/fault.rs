//! Turns a bus error of a guarded access into an error of that access.
//!
//! The interrupted instruction is compared with those of [`guarded`](crate::guarded), and the access
//! returns with an error. It touches nothing but the interrupted context, and is async-signal-safe.

use std::io;

use condor_platform::linux::{BusError, on_bus_error};

use crate::guarded::resume;

/// Lets bus errors of guarded accesses be errors of theirs, in all of the process.
pub(super) fn install() -> io::Result<()> {
    on_bus_error(go_on)
}

fn go_on(error: &mut BusError<'_>) -> bool {
    // SAFETY: where `resume` says, the function of the access returns with an error.
    resume(error.instruction()).is_some_and(|end| unsafe { error.resume_at(end) })
}
