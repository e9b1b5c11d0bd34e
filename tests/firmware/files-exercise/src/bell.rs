//! [`Bell`]: two processors in one program take turns.

use core::cell::Cell;
use core::time::Duration;

use condor_mbox::{Clock, CriticalSection, Doorbell, Instant, Mailbox, Processor};

use crate::memory::{PROCESSORS, Window};

/// Nothing here takes as long, unless something is broken.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);
/// The timeout of waits that must end without success.
pub(crate) const SHORT: Duration = Duration::from_millis(20);

/// The work that one processor does while the other one waits.
pub(crate) type Turn<'t> = Cell<Option<&'t dyn Fn()>>;

/// The mailbox of one of the two.
pub(crate) type Mail<'p> = Mailbox<'p, (Window, Bell<'p>, CriticalSection), PROCESSORS>;

/// The doorbell of one of the two: a processor that waits lets the other one work instead of sleeping, so
/// that no ring is needed.
#[derive(Clone, Copy)]
pub(crate) struct Bell<'t> {
    pub(crate) other: &'t Turn<'t>,
    pub(crate) now: fn() -> Instant,
}

impl Clock for Bell<'_> {
    fn now(&self) -> Instant {
        (self.now)()
    }
}

impl Doorbell for Bell<'_> {
    type Seen = ();

    fn ring(&self, _: Processor) {}

    fn prepare(&self) {}

    fn wait(&self, (): (), _: Instant, _: Option<Processor>) {
        if let Some(program) = self.other.get() {
            program();
        }
    }
}
