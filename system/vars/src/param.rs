//! [`Param`] and [`Params`]: values that other programs may set while a loop runs.

use core::fmt;
use core::ops::RangeInclusive;
use core::sync::atomic::AtomicU32 as Plain;

use crate::scalar::{Scalar, Storage};
use crate::sync::{AtomicU32, Ordering, array_of, const_unless_loom, fence};
use crate::var::{Names, VarDescription, Watch, description};

/// A parameter of a loop: a value within bounds that other programs change, by compare and set, while the loop runs. It
/// is constant within a tick (one run of the loop's body).
///
/// The loop reads it with [`get`](Self::get). A new value is taken over when the next tick begins.
/// If the value is being written at that moment, it is taken over one tick later, so that the loop
/// never waits. A parameter can be watched like a [`Var`](crate::Var), and can be a `static`.
///
/// ```
/// use condor_vars::{Param, ParamRefusal, Tune};
///
/// static STIFFNESS: Param<f64> = Param::new("joint.stiffness", "N m/rad", 2.0, 0.0..=50.0);
/// assert_eq!(STIFFNESS.compare_and_set(2.0, 60.0), Err(ParamRefusal::OutOfBounds));
/// assert_eq!(STIFFNESS.compare_and_set(2.0, 3.0), Ok(()));
/// assert_eq!(STIFFNESS.get(), 2.0);
/// STIFFNESS.latch(); // a `Sampler` does this when a tick begins
/// assert_eq!(STIFFNESS.get(), 3.0);
/// assert!(matches!(STIFFNESS.compare_and_set(2.0, 4.0), Err(ParamRefusal::Conflict { .. })));
/// ```
pub type Param<T> = Params<T, 1>;

/// `N` parameters of one type with the same bounds. The loop takes over new values of all of them
/// together, by one read in each tick.
///
/// Wrap this struct in a type of your own to give each parameter its own unit, or names that are
/// known only at run time; see [`Watch`].
///
/// ```
/// use condor_vars::{Params, Tune};
///
/// static GAINS: Params<f64, 2> = Params::named(&["kp", "kv"], "", [2.0, 0.1], 0.0..=50.0);
/// assert_eq!(GAINS.compare_and_set_at(1, 0.1, 0.2), Ok(()));
/// GAINS.latch(); // a `Sampler` does this when a tick begins
/// assert_eq!([GAINS.get_at(0), GAINS.get_at(1)], [Some(2.0), Some(0.2)]);
/// ```
#[derive(Debug)]
pub struct Params<T: Scalar, const N: usize> {
    names: Names<N>,
    unit: &'static str,
    about: &'static str,
    initial: [T; N],
    bounds: RangeInclusive<T>,
    /// The loop's values, from the first time that they are latched.
    current: [T::Storage; N],
    /// The sequence number of `current`, or [`NEVER`]; only the loop writes it.
    taken: Plain,
    /// The values that were accepted last. Their sequence number is `asked`, 0 for the initial values. The
    /// writers have this copy because loom loses the loop's loads of values that the writers load as well.
    accepted: [T::Storage; N],
    asked: Plain,
    /// The sequence number of `wanted`; odd while `wanted` is written.
    sequence: AtomicU32,
    wanted: [[AtomicU32; 2]; N],
}

/// A sequence number that no complete value has.
const NEVER: u32 = 1;

/// The reason why a parameter was not set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParamRefusal {
    /// The new value is not within the bounds, or is not a value of the type.
    #[error("the value is out of bounds")]
    OutOfBounds,
    /// The parameter does not have the expected value: another context or program has changed it.
    #[error(
        "the parameter was not set: somebody has changed it, and the words of its present value are {:#x} (lower) and \
         {:#x} (upper); read the value and try again",
        .present[0],
        .present[1],
    )]
    Conflict {
        /// The words of the value that was accepted last.
        present: [u32; 2],
    },
}

impl<T: Scalar> Param<T> {
    const_unless_loom! {
        /// Makes a parameter called `name`, of at most 96 bytes, with an initial value and bounds.
        /// `unit` has at most 32 bytes, and may be empty.
        ///
        /// If the initial value is not within the bounds,
        /// [`Selections::open`](crate::Selections::open) returns an error.
        #[must_use]
        pub fn new(
            name: &'static str,
            unit: &'static str,
            initial: T,
            bounds: RangeInclusive<T>,
        ) -> Self {
            Self::with(Names::One(name), unit, [initial], bounds)
        }
    }

    /// Returns the value for the present tick. Only the loop that has the parameter may call this
    /// method.
    #[inline]
    pub fn get(&self) -> T {
        self.get_at(0).unwrap_or_default()
    }

    /// Changes the value from `expected` to `new`. The loop uses the new value from its next tick
    /// on.
    ///
    /// Only one context (a handler, the background or a loop) may call this at a time. If other programs set the
    /// parameter by messages, call this inside of a critical section of the same [`Exclusion`](condor_mbox::Exclusion)
    /// that the server uses.
    ///
    /// # Errors
    /// Returns [`ParamRefusal::OutOfBounds`] if `new` is out of bounds, [`ParamRefusal::Conflict`] if the value
    /// that was accepted last is not `expected`.
    pub fn compare_and_set(&self, expected: T, new: T) -> Result<(), ParamRefusal> {
        self.compare_and_set_at(0, expected, new)
    }
}

impl<T: Scalar, const N: usize> Params<T, N> {
    const_unless_loom! {
        /// Makes `N` parameters with the names `names`, of at most 96 bytes each, and with these
        /// initial values. All have the same bounds and the same unit, which has at most 32 bytes
        /// and may be empty.
        ///
        /// If an initial value is not within the bounds,
        /// [`Selections::open`](crate::Selections::open) returns an error.
        #[must_use]
        pub fn named(
            names: &'static [&'static str; N],
            unit: &'static str,
            initial: [T; N],
            bounds: RangeInclusive<T>,
        ) -> Self {
            Self::with(Names::Each(names), unit, initial, bounds)
        }
    }

    const_unless_loom! {
        fn with(
            names: Names<N>,
            unit: &'static str,
            initial: [T; N],
            bounds: RangeInclusive<T>,
        ) -> Self {
            Self {
                names,
                unit,
                about: "",
                initial,
                bounds,
                current: [const { T::Storage::ZERO }; N],
                taken: Plain::new(NEVER),
                accepted: [const { T::Storage::ZERO }; N],
                asked: Plain::new(0),
                sequence: AtomicU32::new(0),
                wanted: array_of!(array_of!(AtomicU32::new(0); 2); N),
            }
        }
    }

    /// Adds a text for people that describes the parameters of the block, at most 128 bytes.
    #[must_use]
    pub const fn about(mut self, about: &'static str) -> Self {
        self.about = about;
        self
    }

    /// Returns the value of the parameter with index `index` for the present tick; `None` if there
    /// is no such parameter. Only the loop that has the parameters may call this method.
    #[inline]
    pub fn get_at(&self, index: usize) -> Option<T> {
        let initial = *self.initial.get(index)?;
        if self.taken.load(Ordering::Relaxed) == NEVER {
            return Some(initial);
        }
        Some(T::from_words(self.current.get(index)?.load()).unwrap_or(initial))
    }

    /// Returns a number that changes whenever the loop takes over new values. The loop can compare
    /// it with that of its last tick, to compute only then what depends on the parameters. Only the
    /// loop that has the parameters may call this method.
    #[inline]
    pub fn version(&self) -> u32 {
        self.taken.load(Ordering::Relaxed)
    }

    /// Changes the parameter with index `index` from `expected` to `new`, as
    /// [`Param::compare_and_set`] does.
    ///
    /// # Errors
    /// Returns [`ParamRefusal::OutOfBounds`] if `new` is out of bounds or there is no such parameter,
    /// [`ParamRefusal::Conflict`] if the value that was accepted last is not `expected`.
    pub fn compare_and_set_at(
        &self,
        index: usize,
        expected: T,
        new: T,
    ) -> Result<(), ParamRefusal> {
        self.compare_and_set_words(index, expected.to_words(), new.to_words())
    }
}

/// One parameter, or a block of parameters, of any type. [`Params`] implements this trait;
/// implement it for a type of your own that wraps them.
///
/// The parameters have the same indices as in [`Watch::describe`].
pub trait Tune: Watch {
    /// Changes a parameter as [`Params::compare_and_set_at`] does; the values are words.
    ///
    /// # Errors
    /// Returns [`ParamRefusal::OutOfBounds`] if `new` is out of bounds, is not a value of the type, or there is
    /// no such parameter; [`ParamRefusal::Conflict`] if the value that was accepted last is not `expected`.
    fn compare_and_set_words(
        &self,
        index: usize,
        expected: [u32; 2],
        new: [u32; 2],
    ) -> Result<(), ParamRefusal>;

    /// Returns the words of the value of the parameter `index` that was accepted last; zeros if
    /// there is no such parameter. The loop may not have taken the value over yet.
    fn wanted(&self, index: usize) -> [u32; 2];

    /// Returns the words of the value with which the parameter `index` began; zeros if there is no such
    /// parameter.
    fn initial(&self, index: usize) -> [u32; 2];

    /// Takes over the values that were set, unless they are being written at this moment; never waits. The loop
    /// calls this when a tick begins.
    fn latch(&self);

    /// Returns true if all initial values are within the bounds.
    fn is_sound(&self) -> bool;
}

impl<T: Scalar, const N: usize> Tune for Params<T, N> {
    fn compare_and_set_words(
        &self,
        index: usize,
        expected: [u32; 2],
        new: [u32; 2],
    ) -> Result<(), ParamRefusal> {
        let mut all: [_; N] = core::array::from_fn(|index| self.wanted(index));
        let accepted = T::from_words(new).filter(|value| self.bounds.contains(value));
        let place = all.get_mut(index).filter(|_| accepted.is_some());
        let place = place.ok_or(ParamRefusal::OutOfBounds)?;
        if *place != expected {
            return Err(ParamRefusal::Conflict { present: *place });
        }
        *place = new;
        let sequence = self.asked.load(Ordering::Relaxed);
        self.sequence.store(sequence | 1, Ordering::Relaxed);
        // A loop that reads any of the new words passes its fence after this one, so that it finds the
        // odd sequence or a later one.
        fence(Ordering::Release);
        for (word, value) in self.wanted.iter().flatten().zip(all.as_flattened()) {
            word.store(*value, Ordering::Relaxed);
        }
        let next = match sequence.wrapping_add(2) {
            0 => 2,
            next => next,
        };
        // Pairs with the first load of `latch`.
        self.sequence.store(next, Ordering::Release);
        for (accepted, words) in self.accepted.iter().zip(all) {
            accepted.store(words);
        }
        self.asked.store(next, Ordering::Relaxed);
        Ok(())
    }

    fn wanted(&self, index: usize) -> [u32; 2] {
        let words = match self.asked.load(Ordering::Relaxed) {
            0 => self.initial.get(index).map(|value| value.to_words()),
            _ => self.accepted.get(index).map(Storage::load),
        };
        words.unwrap_or_default()
    }

    fn initial(&self, index: usize) -> [u32; 2] {
        let initial = self.initial.get(index);
        initial.map_or([0; 2], |value| value.to_words())
    }

    #[inline]
    fn latch(&self) {
        // Pairs with the last store of `compare_and_set_words`.
        let sequence = self.sequence.load(Ordering::Acquire);
        if sequence == self.taken.load(Ordering::Relaxed) || sequence & 1 != 0 {
            return;
        }
        let words = if sequence == 0 {
            self.initial.map(T::to_words)
        } else {
            let load = |word: &AtomicU32| word.load(Ordering::Relaxed);
            self.wanted.each_ref().map(|it| it.each_ref().map(load))
        };
        fence(Ordering::Acquire);
        if self.sequence.load(Ordering::Relaxed) == sequence {
            for (current, words) in self.current.iter().zip(words) {
                current.store(words);
            }
            self.taken.store(sequence, Ordering::Relaxed);
        }
    }

    fn is_sound(&self) -> bool {
        (self.initial.iter()).all(|initial| self.bounds.contains(initial))
    }
}

impl<T: Scalar, const N: usize> Watch for Params<T, N> {
    fn words(&self) -> &[Plain] {
        T::Storage::words(&self.current)
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        let bounds = [*self.bounds.start(), *self.bounds.end()].map(T::to_words);
        (index < N).then_some(VarDescription {
            bounds,
            ..description::<T>(self.unit, self.about)
        })
    }

    fn name(&self, index: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        self.names.write(index, to)
    }
}
