//! [`Scope`]: loops that borrow.

use core::cell::Cell;
use core::marker::PhantomData;

use crate::body::Body;
use crate::error::LoopError;
use crate::instant::Instant;
use crate::process::Overrun;
use crate::scheduler::LoopId;

/// Where closures become loops until the end of [`Scheduler::scope`](crate::Scheduler::scope).
///
/// A closure, and what it borrows, outlives the scope:
///
/// ```compile_fail,E0597
/// # use condor_mos::{Clock, LoopId, Overrun, Rate, Scan, Scheduler, sim::Processor};
/// # let hertz = Rate::hz(1000);
/// # let schedule = Scan::<1>::new(&[Rate::hz(1)], Clock::of::<u64>(hertz));
/// # let scheduler = Scheduler::new(Processor::new(hertz), schedule);
/// scheduler.scope(|scope| {
///     let mut runs = 0;
///     let mut body = |_| runs += 1;
///     scope.assign(LoopId(0), Overrun::Skip, &mut body)
/// });
/// ```
///
/// It is the loop's alone until then:
///
/// ```compile_fail,E0503
/// # use condor_mos::{Clock, LoopId, Overrun, Rate, Scan, Scheduler, sim::Processor};
/// # let hertz = Rate::hz(1000);
/// # let schedule = Scan::<1>::new(&[Rate::hz(1)], Clock::of::<u64>(hertz));
/// # let scheduler = Scheduler::new(Processor::new(hertz), schedule);
/// let mut runs = 0;
/// let mut body = |_| runs += 1;
/// scheduler.scope(|scope| {
///     scope.assign(LoopId(0), Overrun::Skip, &mut body)?;
///     assert_eq!(runs, 0);
///     Ok::<_, condor_mos::LoopError>(())
/// });
/// ```
pub struct Scope<'scope, 'env: 'scope, I> {
    scheduler: &'scope (dyn Loops<I> + 'scope),
    /// A bit for each loop that was assigned here.
    assigned: Cell<u32>,
    /// `'scope` neither grows nor shrinks: a closure's borrows live until the scope has ended.
    invariant: PhantomData<&'scope mut &'scope ()>,
    env: PhantomData<&'env mut &'env ()>,
}

/// What a scope asks of its scheduler, whose type it does not name: with it, a platform that is
/// borrowed for ever would have closures borrow for as long.
pub(crate) trait Loops<I> {
    fn assign_body(&self, id: LoopId, overrun: Overrun, body: Body<I>) -> Result<(), LoopError>;

    /// Disarms these loops, a bit for each.
    fn withdraw(&self, numbers: u32);
}

impl<'scope, I: Instant> Scope<'scope, '_, I> {
    /// Has a loop run `closure`, which is given the instant at which it was due, and enables it.
    ///
    /// # Errors
    /// [`LoopError::NoSuchLoop`], [`LoopError::Taken`].
    pub fn assign<F: FnMut(I) + Send>(
        &'scope self,
        id: LoopId,
        overrun: Overrun,
        closure: &'scope mut F,
    ) -> Result<(), LoopError> {
        self.scheduler
            .assign_body(id, overrun, Body::of_closure(closure))?;
        self.assigned
            .set(self.assigned.get() | 1_u32.unbounded_shl(u32::from(id.0)));
        Ok(())
    }
}

impl<I> Scope<'_, '_, I> {
    pub(crate) fn run<'env, R>(
        scheduler: &dyn Loops<I>,
        f: impl for<'scope> FnOnce(&'scope Scope<'scope, 'env, I>) -> R,
    ) -> R {
        let scope = Scope {
            scheduler,
            assigned: Cell::new(0),
            invariant: PhantomData,
            env: PhantomData,
        };
        let _withdraw = Withdraw {
            scheduler,
            assigned: &scope.assigned,
        };
        f(&scope)
    }
}

/// Disarms a scope's loops, also when it unwinds.
struct Withdraw<'w, I> {
    scheduler: &'w dyn Loops<I>,
    assigned: &'w Cell<u32>,
}

impl<I> Drop for Withdraw<'_, I> {
    fn drop(&mut self) {
        self.scheduler.withdraw(self.assigned.get());
    }
}
