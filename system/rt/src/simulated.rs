//! The parts of a processor in simulated time, for all machines that have it.
//!
//! `C` leads to the [`LocalClock`] of the processor.

use core::ops::Deref;

use condor_clock::{Handover, LocalClock, Page};
use condor_dev::InterruptEntry;
use condor_mbox::{self as mbox, Clock, Doorbell, Evidence, Exclusion, Instant, MemoryWindow};
use condor_mos::{Armed, ConnectError, Platform, Rate, Timer};

use crate::error::ProgramError;
use crate::lines::{BoardLines, LineState, SERVED_TWICE};

/// Runs `background`, and serves the interrupts of a processor's `lines` by `entry` meanwhile, where `clock` lets them
/// in. Machines in simulated time implement
/// [`with_interrupts`](crate::Machine::with_interrupts) by this.
///
/// # Errors
/// [`ProgramError::Twice`] if they are served already; `background` has not run then.
pub fn with_interrupts<P, H, W, D, S, R>(
    clock: &LocalClock<P, H>,
    lines: &BoardLines<W, D, S>,
    entry: &dyn InterruptEntry,
    background: impl FnOnce() -> R,
) -> Result<R, ProgramError>
where
    P: Deref<Target = Page>,
    H: Handover,
    W: MemoryWindow + Sync,
    D: Doorbell + Sync,
    S: Deref<Target = LineState> + Sync,
{
    let serve = || {
        if lines.is_pending() {
            entry.serve_interrupts();
        }
    };
    let served = lines.serving(|| clock.with_boards(&serve, background))?;
    served.ok_or(SERVED_TWICE)
}

/// The doorbell of a processor in simulated time; `C` dereferences to the [`LocalClock`] of that
/// processor. All clones are the same doorbell.
#[derive(Clone, Debug)]
pub struct SimulatedBell<C>(pub C);

impl<C, P, H> Clock for SimulatedBell<C>
where
    C: Deref<Target = LocalClock<P, H>>,
    P: Deref<Target = Page>,
    H: Handover,
{
    fn now(&self) -> Instant {
        Instant::from_ns(self.0.read())
    }
}

impl<C, P, H> Doorbell for SimulatedBell<C>
where
    C: Deref<Target = LocalClock<P, H>>,
    P: Deref<Target = Page>,
    H: Handover,
{
    type Seen = u32;

    fn ring(&self, processor: mbox::Processor) {
        self.0.ring(processor.0);
    }

    fn prepare(&self) -> u32 {
        self.0.rings()
    }

    fn wait(&self, seen: u32, until: Instant, whom: Option<mbox::Processor>) {
        self.0.wait(seen, until.as_ns(), whom.map(|whom| whom.0));
    }

    fn rings_always(&self) -> bool {
        true
    }

    fn ends_serving(&self, sender: mbox::Processor) -> bool {
        !self.0.page().is_service(sender.0)
    }

    fn waits_for_listener(&self, listener: mbox::Processor) -> bool {
        self.0.page().is_processor(listener.0)
    }

    fn evidence(&self, processor: mbox::Processor) -> Evidence {
        let page = self.0.page();
        if page.is_alive(processor.0) || page.is_service(processor.0) {
            Evidence::Alive
        } else {
            Evidence::Dead
        }
    }
}

/// The critical sections of a processor in simulated time: no time passes in them, so nothing
/// interrupts them. `C` dereferences to the [`LocalClock`] of that processor. All clones are the
/// same sections.
#[derive(Clone, Debug)]
pub struct SimulatedSection<C>(pub C);

impl<C, P, H> Exclusion for SimulatedSection<C>
where
    C: Deref<Target = LocalClock<P, H>>,
    P: Deref<Target = Page>,
    H: Handover,
{
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        self.0.standing_still(body)
    }
}

/// The timer that releases the loops of a processor in simulated time. It counts nanoseconds. `C`
/// dereferences to the [`LocalClock`] of that processor. All clones are the same timer.
#[derive(Clone, Debug)]
pub struct SimulatedTimer<C>(pub C);

impl<C, P, H> Timer for SimulatedTimer<C>
where
    C: Deref<Target = LocalClock<P, H>>,
    P: Deref<Target = Page>,
    H: Handover,
{
    type Instant = u64;

    fn frequency(&self) -> Rate {
        Rate::hz(1_000_000_000)
    }

    fn now(&self) -> u64 {
        self.0.read_timer()
    }

    fn arm(&self, at: u64) -> Armed {
        if self.0.arm(at) {
            Armed::Ahead
        } else {
            Armed::Past
        }
    }

    fn disarm(&self) {
        self.0.disarm();
    }
}

impl<C, P, H> Platform for SimulatedTimer<C>
where
    C: Deref<Target = LocalClock<P, H>>,
    P: Deref<Target = Page>,
    H: Handover,
{
    fn connect<R>(
        &self,
        handler: impl Fn() + Sync,
        program: impl FnOnce() -> R,
    ) -> Result<R, ConnectError> {
        let connected = self.0.with_handler(&handler, program);
        connected.ok_or(ConnectError::Connected)
    }

    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.0.run_loop(rank, body);
    }
}
