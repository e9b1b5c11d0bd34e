//! `condor-fs` and `condor-tty`: files of a host and terminals, on a hart and on a core without compare-and-swap.
//!
//! The host is a second mailbox of the same program, which works whenever the processor waits. How client and
//! server work together is tested on Linux, in `condor-fs`.
#![no_std]
#![no_main]

mod ends;
mod files;
mod host;
mod kept;
mod terminals;

use core::error::Error;
use core::fmt::Write as _;
use core::time::Duration;

use condor_mbox::{CriticalSection, Mailbox, Processor, StaticWindow};
use condor_tty::Terminal;
use firmware::{Checks, Console, check};

/// The processors of the system.
const PROCESSORS: usize = 2;
/// The processor that has the files, and looks at the terminals.
const HOST: Processor = Processor(0);
/// The processor that opens files, and has terminals.
const HAND: Processor = Processor(1);

/// The memory of either.
type Window = StaticWindow<'static>;
/// The mailbox of either.
type Mail = Mailbox<'static, (Window, ends::Bell, CriticalSection), PROCESSORS>;
/// A terminal, at which some characters can be typed ahead.
type Tty = Terminal<Window, CriticalSection, 16>;

/// Nothing here takes as long, unless something is broken.
const PATIENCE: Duration = Duration::from_secs(20);

#[firmware::entry]
fn main() -> ! {
    #[cfg(target_arch = "arm")]
    firmware::start_clock();
    #[cfg(target_arch = "riscv64")]
    firmware::switch_floats_off();
    check(|checks| {
        kept::kept();
        let exercised = exercise(checks);
        checks.that(exercised.is_ok());
        #[cfg(target_arch = "arm")]
        stack(checks);
    })
}

fn exercise(checks: &mut Checks) -> Result<(), Told> {
    let (ends, system) = files::connect(checks)?;
    files::files(checks, &system)?;
    terminals::terminals(checks, ends)
}

/// Checks the stack that all of it takes, including that of the checks and the host's end.
#[cfg(target_arch = "arm")]
fn stack(checks: &mut Checks) {
    checks.group("the stack");
    let used = firmware::stack_used();
    // The console takes everything.
    let _ = writeln!(Console, "          {used} bytes were in use at most");
    checks.that(used <= 12 * 1024);
}

/// A call that must succeed did not, and its error is on the console.
struct Told;

impl<E: Error> From<E> for Told {
    fn from(error: E) -> Self {
        // The console takes everything.
        let _ = writeln!(Console, "{error}");
        Self
    }
}
