//! [`Param`]: what others may set while a loop runs.

use core::fmt;
use core::ops::RangeInclusive;
use core::sync::atomic::AtomicU32 as Plain;

use crate::scalar::{Scalar, Storage};
use crate::sync::{AtomicU32, Ordering, array_of, const_unless_loom, fence};
use crate::var::{Description, Watch, description};

/// A parameter of a loop: it has bounds, is changed by compare and set, and stays the same within a tick.
///
/// The loop reads it with [`get`](Self::get). A change is taken over when the next tick begins; one that
/// is just being written then is taken over a tick later, so that the loop never waits. It can be watched
/// like a [`Var`](crate::Var), and can be a `static`.
///
/// ```
/// use condor_vars::{Param, Refusal, Tune};
///
/// static STIFFNESS: Param<f64> = Param::new("joint.stiffness", "N m/rad", 2.0, 0.0..=50.0);
/// assert_eq!(STIFFNESS.compare_and_set(2.0, 60.0), Err(Refusal::OutOfBounds));
/// assert_eq!(STIFFNESS.compare_and_set(2.0, 3.0), Ok(()));
/// assert_eq!(STIFFNESS.get(), 2.0);
/// STIFFNESS.latch(); // a `Sampler` does this when a tick begins
/// assert_eq!(STIFFNESS.get(), 3.0);
/// assert!(matches!(STIFFNESS.compare_and_set(2.0, 4.0), Err(Refusal::Conflict { .. })));
/// ```
#[derive(Debug)]
pub struct Param<T: Scalar> {
    name: &'static str,
    unit: &'static str,
    about: &'static str,
    initial: T,
    bounds: RangeInclusive<T>,
    /// The loop's value, from the first time that it is latched.
    current: T::Storage,
    /// The sequence of `current`, or [`NEVER`]; the loop's.
    taken: Plain,
    /// The value that was accepted last, and its sequence; 0 of the initial value. Those who set have this
    /// copy of their own, since loom loses the loop's loads of what its writers load as well.
    accepted: T::Storage,
    asked: Plain,
    /// The sequence of `wanted`; odd while that is written.
    sequence: AtomicU32,
    wanted: [AtomicU32; 2],
}

/// A sequence that no complete value has.
const NEVER: u32 = 1;

/// Why a parameter was not set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// The new value is not within the bounds, or none of the type's.
    #[error("the value is out of bounds")]
    OutOfBounds,
    /// The parameter is not what was expected: somebody else has changed it.
    #[error("the parameter is not what was expected, but has the words {present:x?}")]
    Conflict {
        /// What it is to become in the next tick, or has been for longer.
        present: [u32; 2],
    },
}

impl<T: Scalar> Param<T> {
    const_unless_loom! {
        /// Makes a parameter with an initial value, and the least and the greatest that it takes.
        ///
        /// An initial value that is not within the bounds is an error when the loop is set up.
        #[must_use]
        pub fn new(
            name: &'static str,
            unit: &'static str,
            initial: T,
            bounds: RangeInclusive<T>,
        ) -> Self {
            Self {
                name,
                unit,
                about: "",
                initial,
                bounds,
                current: T::Storage::ZERO,
                taken: Plain::new(NEVER),
                accepted: T::Storage::ZERO,
                asked: Plain::new(0),
                sequence: AtomicU32::new(0),
                wanted: array_of!(AtomicU32::new(0); 2),
            }
        }
    }

    /// Adds a description, at most 128 bytes.
    #[must_use]
    pub const fn about(mut self, about: &'static str) -> Self {
        self.about = about;
        self
    }

    /// Returns its value, the same for a whole tick: for the loop that has it.
    #[inline]
    pub fn get(&self) -> T {
        if self.taken.load(Ordering::Relaxed) == NEVER {
            return self.initial;
        }
        T::from_words(self.current.load()).unwrap_or(self.initial)
    }

    /// Changes it from `expected` to `new`, from the next tick on.
    ///
    /// One context at a time may do so: where others set it by messages, call this inside of the same
    /// [`Exclusion`](condor_mbox::Exclusion).
    ///
    /// # Errors
    /// [`Refusal::OutOfBounds`], [`Refusal::Conflict`].
    pub fn compare_and_set(&self, expected: T, new: T) -> Result<(), Refusal> {
        self.compare_and_set_words(expected.to_words(), new.to_words())
    }
}

/// A parameter, whatever its type. [`Param`] is the one there is.
pub trait Tune: Watch {
    /// [`Param::compare_and_set`], with the words of the values.
    ///
    /// # Errors
    /// Those of [`Param::compare_and_set`].
    fn compare_and_set_words(&self, expected: [u32; 2], new: [u32; 2]) -> Result<(), Refusal>;

    /// Returns the words of the value that was accepted last, which the loop may not have taken over.
    fn wanted(&self) -> [u32; 2];

    /// Takes over what was set, if it is complete: for the loop, when a tick begins. Never waits.
    fn latch(&self);

    /// Whether the initial value is within the bounds.
    fn is_sound(&self) -> bool;
}

impl<T: Scalar> Tune for Param<T> {
    fn compare_and_set_words(&self, expected: [u32; 2], new: [u32; 2]) -> Result<(), Refusal> {
        if !T::from_words(new).is_some_and(|value| self.bounds.contains(&value)) {
            return Err(Refusal::OutOfBounds);
        }
        let present = self.wanted();
        if present != expected {
            return Err(Refusal::Conflict { present });
        }
        let sequence = self.asked.load(Ordering::Relaxed);
        self.sequence.store(sequence | 1, Ordering::Relaxed);
        // A loop that reads any of the new words passes its fence after this one, so that it finds the
        // odd sequence or a later one.
        fence(Ordering::Release);
        for (word, value) in self.wanted.iter().zip(new) {
            word.store(value, Ordering::Relaxed);
        }
        let next = match sequence.wrapping_add(2) {
            0 => 2,
            next => next,
        };
        // Pairs with the first load of `latch`.
        self.sequence.store(next, Ordering::Release);
        self.accepted.store(new);
        self.asked.store(next, Ordering::Relaxed);
        Ok(())
    }

    fn wanted(&self) -> [u32; 2] {
        match self.asked.load(Ordering::Relaxed) {
            0 => self.initial.to_words(),
            _ => self.accepted.load(),
        }
    }

    #[inline]
    fn latch(&self) {
        // Pairs with the last store of `compare_and_set_words`.
        let sequence = self.sequence.load(Ordering::Acquire);
        if sequence == self.taken.load(Ordering::Relaxed) || sequence & 1 != 0 {
            return;
        }
        let words = if sequence == 0 {
            self.initial.to_words()
        } else {
            self.wanted.each_ref().map(|it| it.load(Ordering::Relaxed))
        };
        fence(Ordering::Acquire);
        if self.sequence.load(Ordering::Relaxed) == sequence {
            self.current.store(words);
            self.taken.store(sequence, Ordering::Relaxed);
        }
    }

    fn is_sound(&self) -> bool {
        self.bounds.contains(&self.initial)
    }
}

impl<T: Scalar> Watch for Param<T> {
    fn words(&self) -> &[Plain] {
        T::Storage::words(core::slice::from_ref(&self.current))
    }

    fn describe(&self, index: usize) -> Option<Description<'_>> {
        let bounds = [*self.bounds.start(), *self.bounds.end()].map(T::to_words);
        (index == 0).then_some(Description {
            bounds,
            ..description::<T>(self.unit, self.about)
        })
    }

    fn name(&self, _: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        to.write_str(self.name)
    }
}
