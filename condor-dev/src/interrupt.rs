//! [`InterruptController`]: which interrupt came, and which may come.

/// The number of an interrupt, as its controller gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Vector(pub u16);

/// How urgent an interrupt is: a higher level interrupts a lower one; 0 never interrupts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Level(pub u8);

/// What brings the interrupts of boards to one processor.
///
/// # For users
/// [`Switch::on_interrupt`](crate::Switch::on_interrupt) claims, serves and completes; a program
/// that has a switch calls none of these itself.
///
/// # For implementers
/// * `claim` gives the pending enabled vector of the highest level, and withdraws it from other
///   processors until it is completed; `None` if there is none, which is a spurious interrupt.
/// * A vector whose board still asks for attention is pending again after `complete`.
/// * A vector that is disabled is never claimed; what it asked for meanwhile is pending when it is
///   enabled again.
/// * Vectors that the controller does not have are ignored by all calls.
///
/// Call [`conformance::interrupt_controller`](conformance/fn.interrupt_controller.html) from one test.
pub trait InterruptController {
    /// Lets a vector interrupt, at a level.
    fn enable(&self, vector: Vector, level: Level);

    /// Lets it interrupt no more.
    fn disable(&self, vector: Vector);

    /// Takes the most urgent vector that is pending.
    fn claim(&self) -> Option<Vector>;

    /// Ends what [`claim`](Self::claim) began.
    fn complete(&self, vector: Vector);
}

impl<C: InterruptController + ?Sized> InterruptController for &C {
    #[inline]
    fn enable(&self, vector: Vector, level: Level) {
        C::enable(self, vector, level);
    }

    #[inline]
    fn disable(&self, vector: Vector) {
        C::disable(self, vector);
    }

    #[inline]
    fn claim(&self) -> Option<Vector> {
        C::claim(self)
    }

    #[inline]
    fn complete(&self, vector: Vector) {
        C::complete(self, vector);
    }
}

/// For systems in which no board interrupts.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoInterrupts;

impl InterruptController for NoInterrupts {
    fn enable(&self, _: Vector, _: Level) {}

    fn disable(&self, _: Vector) {}

    fn claim(&self) -> Option<Vector> {
        None
    }

    fn complete(&self, _: Vector) {}
}
