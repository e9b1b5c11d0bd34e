//! [`InterruptController`]: enables, claims and completes interrupts.

/// The number of an interrupt vector, as the interrupt controller counts its vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InterruptVector(pub u16);

/// The urgency of an interrupt: a higher level interrupts a lower one; 0 never interrupts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct InterruptLevel(pub u8);

/// The controller that delivers the interrupts of boards to one processor.
///
/// # For users
/// [`Switch::on_interrupt`](crate::Switch::on_interrupt) claims, serves and completes interrupts; a
/// program that has a switch does not call these methods itself.
///
/// # For implementers
/// * `claim` returns the pending enabled vector of the highest level, and keeps it from other
///   processors until it is completed. It returns `None` if there is none; that is a spurious
///   interrupt.
/// * If a board still asks for service after `complete`, its vector is pending again. A controller of
///   edges has no level to look at: with it, each request that came since `claim` makes the vector
///   pending again.
/// * A disabled vector is never claimed; a request that came meanwhile is pending when the vector
///   is enabled again.
/// * All methods ignore vectors that the controller does not have.
///
/// Call [`conformance::interrupt_controller`](conformance/fn.interrupt_controller.html) from a
/// test: it checks these rules.
pub trait InterruptController {
    /// Enables a vector, and sets its level.
    fn enable(&self, vector: InterruptVector, level: InterruptLevel);

    /// Disables a vector.
    fn disable(&self, vector: InterruptVector);

    /// Claims the most urgent vector that is pending, and returns it; `None` if none is pending and
    /// enabled.
    fn claim(&self) -> Option<InterruptVector>;

    /// Completes the service of a vector that [`claim`](Self::claim) returned; it can be claimed again.
    fn complete(&self, vector: InterruptVector);
}

impl<C: InterruptController + ?Sized> InterruptController for &C {
    #[inline]
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        C::enable(self, vector, level);
    }

    #[inline]
    fn disable(&self, vector: InterruptVector) {
        C::disable(self, vector);
    }

    #[inline]
    fn claim(&self) -> Option<InterruptVector> {
        C::claim(self)
    }

    #[inline]
    fn complete(&self, vector: InterruptVector) {
        C::complete(self, vector);
    }
}

/// An [`InterruptController`] that never interrupts, for a [`Switch`](crate::Switch) in which no
/// board interrupts.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoInterrupts;

impl InterruptController for NoInterrupts {
    fn enable(&self, _: InterruptVector, _: InterruptLevel) {}

    fn disable(&self, _: InterruptVector) {}

    fn claim(&self) -> Option<InterruptVector> {
        None
    }

    fn complete(&self, _: InterruptVector) {}
}
