//! [`Var`] and [`Vars`]: values that a loop shows.

use core::fmt;
use core::sync::atomic::AtomicU32;

use crate::kind::ValueKind;
use crate::scalar::{Scalar, Storage};

/// A variable that a loop sets and other programs watch.
///
/// The variable lies in the program's own memory, and [`set`](Self::set) stores one 32-bit word, or two. Watching
/// programs get the value that the variable has at the end of the loop's body. A variable can be a `static`.
///
/// ```
/// use condor_vars::Var;
///
/// static POSITION: Var<f64> = Var::new("joint.position", "rad").about("Filtered.");
/// POSITION.set(0.25);
/// assert_eq!(POSITION.get(), 0.25);
/// ```
pub type Var<T> = Vars<T, 1>;

impl<T: Scalar> Var<T> {
    /// Makes a variable called `name`, of at most 96 bytes. `unit` has at most 32 bytes, and may be empty. The value is
    /// the default of `T`, such as 0, until it is set.
    #[must_use]
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        Self::with(Names::One(name), unit)
    }

    /// Sets the value. Only one context may call this: the loop that shows the variable.
    #[inline(always)]
    pub fn set(&self, value: T) {
        self.set_all(&[value]);
    }

    /// Returns the value that was set last. Call it in the context that sets the variable: elsewhere
    /// a value of 64 bits may be half new and half old.
    #[inline(always)]
    pub fn get(&self) -> T {
        let [storage] = &self.storage;
        T::from_words(storage.load()).unwrap_or_default()
    }
}

/// A block of `N` variables of one type, side by side in memory, which a loop samples by one copy.
///
/// ```
/// use condor_vars::Vars;
///
/// static TENSIONS: Vars<f32, 2> = Vars::named(&["index.flexor", "index.extensor"], "N");
/// static ANGLES: Vars<f64, 16> = Vars::numbered("angle", "rad"); // angle.0 to angle.15
/// TENSIONS.set_at(1, 4.5);
/// ANGLES.set_all(&[0.1; 16]);
/// ```
#[derive(Debug)]
pub struct Vars<T: Scalar, const N: usize> {
    storage: [T::Storage; N],
    names: Names<N>,
    unit: &'static str,
    about: &'static str,
}

/// The names of the variables of a block.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Names<const N: usize> {
    One(&'static str),
    Each(&'static [&'static str; N]),
    Numbered(&'static str),
    Formatted(fn(usize, &mut dyn fmt::Write) -> fmt::Result),
}

impl<const N: usize> Names<N> {
    pub(crate) fn write(&self, index: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        match *self {
            Self::One(name) => to.write_str(name),
            Self::Each(names) => to.write_str(names.get(index).copied().unwrap_or_default()),
            Self::Numbered(name) => write!(to, "{name}.{index}"),
            Self::Formatted(name) => name(index, to),
        }
    }
}

impl<T: Scalar, const N: usize> Vars<T, N> {
    /// Makes `N` variables with the names `names`, of at most 96 bytes each, and a common unit of
    /// at most 32 bytes. Their value is the default of `T`, such as 0, until it is set.
    #[must_use]
    pub const fn named(names: &'static [&'static str; N], unit: &'static str) -> Self {
        Self::with(Names::Each(names), unit)
    }

    /// Makes `N` variables that are called `name.0`, `name.1` and so on, with a common unit of at
    /// most 32 bytes. Their value is the default of `T`, such as 0, until it is set.
    #[must_use]
    pub const fn numbered(name: &'static str, unit: &'static str) -> Self {
        Self::with(Names::Numbered(name), unit)
    }

    /// Makes `N` variables whose names are written by the function `name`, which gets the index of
    /// a variable. They have a common unit of at most 32 bytes. Their value is the default of `T`,
    /// such as 0, until it is set.
    #[must_use]
    pub const fn formatted(
        name: fn(usize, &mut dyn fmt::Write) -> fmt::Result,
        unit: &'static str,
    ) -> Self {
        Self::with(Names::Formatted(name), unit)
    }

    const fn with(names: Names<N>, unit: &'static str) -> Self {
        Self {
            storage: [const { T::Storage::ZERO }; N],
            names,
            unit,
            about: "",
        }
    }

    /// Adds a text for people that describes the variables of the block, at most 128 bytes.
    #[must_use]
    pub const fn about(mut self, about: &'static str) -> Self {
        self.about = about;
        self
    }

    /// Sets the variable with index `index`; does nothing if there is no such variable. Only one
    /// context may call this: the loop that shows the variables.
    #[inline(always)]
    pub fn set_at(&self, index: usize, value: T) {
        if let Some(storage) = self.storage.get(index) {
            storage.store(value.to_words());
        }
    }

    /// Sets all variables of the block. Only one context may call this: the loop that shows the
    /// variables.
    #[inline(always)]
    pub fn set_all(&self, values: &[T; N]) {
        for (storage, value) in self.storage.iter().zip(values) {
            storage.store(value.to_words());
        }
    }
}

/// One variable, or a block of variables side by side in the program's memory, that a loop can
/// show.
///
/// # For implementers
///
/// [`Var`] and [`Vars`] are enough for most programs. Implement this trait for a struct whose names
/// are known only at run time, or whose variables have several types. `words` must always return
/// the same words. The variables use these words in order, one or two each as their kinds say,
/// until all words are used.
pub trait Watch: Sync {
    /// Returns the words of all variables.
    fn words(&self) -> &[AtomicU32];

    /// Returns the description of the variable `index`; `None` after the last.
    fn describe(&self, index: usize) -> Option<VarDescription<'_>>;

    /// Writes the name of the variable `index`, at most 96 bytes.
    ///
    /// # Errors
    /// Returns [`fmt::Error`] if `to` returns it.
    fn name(&self, index: usize, to: &mut dyn fmt::Write) -> fmt::Result;
}

/// The description of a variable or parameter, which [`Watch::describe`] returns: all that tools
/// know of it, except its name.
#[derive(Clone, Copy, Debug)]
pub struct VarDescription<'d> {
    /// The type.
    pub kind: ValueKind,
    /// The unit, at most 32 bytes; empty if there is none.
    pub unit: &'d str,
    /// A text about the variable, at most 128 bytes; may be empty.
    pub about: &'d str,
    /// The names of an enum's values, at most 255 of 32 bytes each; empty for all other types.
    pub labels: &'d [&'d str],
    /// The words of the least and of the greatest value that a parameter takes; 0 for a variable.
    pub bounds: [[u32; 2]; 2],
}

impl<T: Scalar, const N: usize> Watch for Vars<T, N> {
    fn words(&self) -> &[AtomicU32] {
        T::Storage::words(&self.storage)
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        (index < N).then_some(description::<T>(self.unit, self.about))
    }

    fn name(&self, index: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        self.names.write(index, to)
    }
}

pub(crate) const fn description<T: Scalar>(
    unit: &'static str,
    about: &'static str,
) -> VarDescription<'static> {
    VarDescription {
        kind: T::KIND,
        unit,
        about,
        labels: T::LABELS,
        bounds: [[0; 2]; 2],
    }
}
