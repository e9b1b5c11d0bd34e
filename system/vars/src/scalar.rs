//! [`Scalar`]: the types of variables and parameters.

use core::fmt::Debug;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::kind::{ValueKind, join, split};

/// A type that variables and parameters can have: numbers, `bool`, and enums made with
/// [`choice!`](crate::choice).
///
/// The words that store the default value of the type must be 0.
pub trait Scalar: Copy + Default + PartialOrd + Debug + Send + Sync + 'static {
    /// The type of the words that store a value.
    type Storage: Storage;
    /// The kind, by which tables describe the type.
    const KIND: ValueKind;
    /// The names of an enum's values, by number; empty for all other types.
    const LABELS: &'static [&'static str] = &[];

    /// Returns the words of a value, the lower first; the second is 0 if there is only one.
    fn to_words(self) -> [u32; 2];

    /// Returns the value of the words; `None` if no value has these words.
    fn from_words(words: [u32; 2]) -> Option<Self>;
}

/// The memory in which the value of a [`Scalar`] is stored: one or two [`AtomicU32`].
///
/// Only one context writes this memory. Another context that interrupts it, or runs beside it, may read one new word
/// and one old word.
pub trait Storage: Debug + Sync + sealed::Sealed + 'static {
    /// Words that are all 0.
    const ZERO: Self;

    /// Reads the words; the second is 0 if there is only one.
    fn load(&self) -> [u32; 2];

    /// Writes the words; ignores the second if there is only one.
    fn store(&self, words: [u32; 2]);

    /// Returns the words of values that lie side by side in memory.
    fn words(values: &[Self]) -> &[AtomicU32]
    where
        Self: Sized;
}

impl<const N: usize> Storage for [AtomicU32; N] {
    const ZERO: Self = [const { AtomicU32::new(0) }; N];

    #[inline(always)]
    fn load(&self) -> [u32; 2] {
        let mut words = [0; 2];
        for (to, word) in words.iter_mut().zip(self) {
            *to = word.load(Relaxed);
        }
        words
    }

    #[inline(always)]
    fn store(&self, words: [u32; 2]) {
        for (word, from) in self.iter().zip(words) {
            word.store(from, Relaxed);
        }
    }

    fn words(values: &[Self]) -> &[AtomicU32] {
        values.as_flattened()
    }
}

mod sealed {
    pub trait Sealed {}
    impl<const N: usize> Sealed for [core::sync::atomic::AtomicU32; N] {}
}

macro_rules! scalars {
    ($($type:ty, $kind:ident, $words:literal, |$value:ident| $to:expr, |$from:ident| $of:expr;)*) => {$(
        impl Scalar for $type {
            type Storage = [AtomicU32; $words];
            const KIND: ValueKind = ValueKind::$kind;

            #[inline(always)]
            fn to_words(self) -> [u32; 2] {
                let $value = self;
                $to
            }

            #[inline(always)]
            fn from_words($from: [u32; 2]) -> Option<Self> {
                $of
            }
        }
    )*};
}

scalars! {
    f32, F32, 1, |value| [value.to_bits(), 0], |words| Some(f32::from_bits(words[0]));
    f64, F64, 2, |value| split(value.to_bits()), |words| Some(f64::from_bits(join(words)));
    i8, I8, 1, |value| [i32::from(value).cast_unsigned(), 0], |words| words[0].cast_signed().try_into().ok();
    i16, I16, 1, |value| [i32::from(value).cast_unsigned(), 0], |words| words[0].cast_signed().try_into().ok();
    i32, I32, 1, |value| [value.cast_unsigned(), 0], |words| Some(words[0].cast_signed());
    i64, I64, 2, |value| split(value.cast_unsigned()), |words| Some(join(words).cast_signed());
    u8, U8, 1, |value| [value.into(), 0], |words| words[0].try_into().ok();
    u16, U16, 1, |value| [value.into(), 0], |words| words[0].try_into().ok();
    u32, U32, 1, |value| [value, 0], |words| Some(words[0]);
    u64, U64, 2, |value| split(value), |words| Some(join(words));
    bool, Bool, 1, |value| [value.into(), 0], |words| match words[0] { 0 => Some(false), 1 => Some(true), _ => None };
}

/// Makes an enum whose values have names, for variables and parameters.
///
/// The values are numbered from 0; the first is the default. The names are shown to people; each has at most 32
/// bytes.
///
/// ```
/// use condor_vars::{Param, Scalar, choice};
///
/// choice! {
///     /// What the hand does.
///     pub enum Mode {
///         /// Nothing.
///         Idle = "idle",
///         /// Keeps its posture.
///         Hold = "hold",
///     }
/// }
///
/// static MODE: Param<Mode> = Param::new("hand.mode", "", Mode::Idle, Mode::Idle..=Mode::Hold);
/// assert_eq!(MODE.get(), Mode::Idle);
/// assert_eq!(Mode::LABELS, ["idle", "hold"]);
/// ```
#[macro_export]
macro_rules! choice {
    ($(#[$meta:meta])* $visibility:vis enum $name:ident {
        $($(#[$of_value:meta])* $value:ident = $label:literal),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[repr(u32)]
        $visibility enum $name {
            $($(#[$of_value])* $value,)+
        }

        impl Default for $name {
            fn default() -> Self {
                const VALUES: &[$name] = &[$($name::$value),+];
                VALUES[0]
            }
        }

        impl $crate::Scalar for $name {
            type Storage = [::core::sync::atomic::AtomicU32; 1];
            const KIND: $crate::ValueKind = $crate::ValueKind::Choice;
            const LABELS: &'static [&'static str] = &[$($label),+];

            fn to_words(self) -> [u32; 2] {
                [self as u32, 0]
            }

            fn from_words([word, _]: [u32; 2]) -> Option<Self> {
                [$(Self::$value),+].into_iter().find(|value| *value as u32 == word)
            }
        }
    };
}
