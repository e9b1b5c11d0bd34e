//! [`Scope`]: loops that borrow.

use core::cell::Cell;
use core::marker::PhantomData;

use crate::body::LoopBody;
use crate::error::LoopError;
use crate::instant::CounterReading;
use crate::process::{LoopId, Overrun};
use crate::runner::Runner;

/// A scope in which closures that borrow data can become loops.
/// [`Loops::scope`](crate::Loops::scope) makes it; at its end the loops stop.
///
/// A closure, and everything that it borrows, must outlive the scope:
///
/// ```compile_fail,E0597
/// # use condor_mos::{ClockSpec, LoopId, Loops, Overrun, Rate, Scan, Scheduler, sim::SimPlatform};
/// # let hertz = Rate::hz(1000);
/// # let schedule = Scan::<1>::new(&[Rate::hz(1)], ClockSpec::of::<u64>(hertz));
/// # let scheduler = Scheduler::new(SimPlatform::new(hertz), schedule);
/// scheduler.scope(|scope| {
///     let mut runs = 0;
///     let mut body = |_| runs += 1;
///     scope.assign(LoopId(0), Overrun::Skip, &mut body)
/// });
/// ```
///
/// Until the end of the scope, only the loop can use what the closure borrows:
///
/// ```compile_fail,E0503
/// # use condor_mos::{ClockSpec, LoopId, Loops, Overrun, Rate, Scan, Scheduler, sim::SimPlatform};
/// # let hertz = Rate::hz(1000);
/// # let schedule = Scan::<1>::new(&[Rate::hz(1)], ClockSpec::of::<u64>(hertz));
/// # let scheduler = Scheduler::new(SimPlatform::new(hertz), schedule);
/// let mut runs = 0;
/// let mut body = |_| runs += 1;
/// scheduler.scope(|scope| {
///     scope.assign(LoopId(0), Overrun::Skip, &mut body)?;
///     assert_eq!(runs, 0);
///     Ok::<_, condor_mos::LoopError>(())
/// });
/// ```
pub struct Scope<'scope, 'env: 'scope, I> {
    /// Its type is not named: with it, a platform that is borrowed for ever would have closures borrow
    /// for as long.
    loops: &'scope (dyn Runner<Instant = I> + 'scope),
    /// A bit for each loop that was assigned here.
    assigned: Cell<u32>,
    /// `'scope` neither grows nor shrinks: a closure's borrows live until the scope has ended.
    invariant: PhantomData<&'scope mut &'scope ()>,
    env: PhantomData<&'env mut &'env ()>,
}

impl<'scope, I: CounterReading> Scope<'scope, '_, I> {
    /// Makes `closure` the body of the loop `id`, and enables the loop. Each run calls the closure
    /// with the instant at which the loop was due. `overrun` says what happens if the loop is due
    /// again before a run has finished.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`] if there is no such loop, [`LoopError::Taken`] if it has a body,
    /// [`LoopError::NoThread`] if a thread cannot be started.
    pub fn assign<F: FnMut(I) + Send>(
        &'scope self,
        id: LoopId,
        overrun: Overrun,
        closure: &'scope mut F,
    ) -> Result<(), LoopError> {
        self.loops
            .assign_body(id, overrun, LoopBody::of_closure(closure))?;
        self.assigned
            .set(self.assigned.get() | 1_u32.unbounded_shl(u32::from(id.0)));
        Ok(())
    }
}

impl<I: CounterReading> Scope<'_, '_, I> {
    pub(crate) fn run<'env, R>(
        loops: &dyn Runner<Instant = I>,
        f: impl for<'scope> FnOnce(&'scope Scope<'scope, 'env, I>) -> R,
    ) -> R {
        let scope = Scope {
            loops,
            assigned: Cell::new(0),
            invariant: PhantomData,
            env: PhantomData,
        };
        let _withdraw = Withdraw {
            loops,
            assigned: &scope.assigned,
        };
        f(&scope)
    }
}

/// Disarms a scope's loops, also when it unwinds.
struct Withdraw<'w, I: CounterReading> {
    loops: &'w dyn Runner<Instant = I>,
    assigned: &'w Cell<u32>,
}

impl<I: CounterReading> Drop for Withdraw<'_, I> {
    fn drop(&mut self) {
        self.loops.withdraw(self.assigned.get());
    }
}
