//! [`Bell`]: two processors in one program take turns.

use core::cell::Cell;

use condor_mbox::{Clock, Doorbell, Instant, Processor};

use crate::memory::PROCESSORS;

/// What each processor does while the other one waits.
pub(crate) struct Turns<'t> {
    programs: [Cell<Option<&'t dyn Fn()>>; PROCESSORS],
}

impl<'t> Turns<'t> {
    pub(crate) const fn new() -> Self {
        Self {
            programs: [const { Cell::new(None) }; PROCESSORS],
        }
    }

    /// From now on `processor` does `program`.
    pub(crate) fn assign(&self, processor: Processor, program: &'t dyn Fn()) {
        if let Some(place) = self.programs.get(processor.index()) {
            place.set(Some(program));
        }
    }
}

/// The doorbell of one of the two: who waits gives the other one the turn instead of sleeping, so
/// that nobody needs a ring.
#[derive(Clone, Copy)]
pub(crate) struct Bell<'t> {
    pub(crate) other: Processor,
    pub(crate) turns: &'t Turns<'t>,
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
        if let Some(program) = self.turns.programs.get(self.other.index())
            && let Some(program) = program.get()
        {
            program();
        }
    }
}
