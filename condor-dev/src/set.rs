//! [`DeviceSet`]: the devices that a program was built for.

#[doc(hidden)]
pub use crate::record::VectorRecord;

use crate::driver::Driver;
use crate::fd::Entry;
use crate::interrupt::InterruptVector;
use crate::unit::{Location, Unit};

/// The set of boards for which a program is built, grouped by kind. A program does not implement
/// this trait itself: [`device_switch!`](crate::device_switch) declares a type that does.
///
/// A kind is a field in the call of the macro. Kinds, and the boards of a kind, are numbered from 0
/// in the order in which they are written there. The slot of a board is the number `kind << 6 |
/// board`.
pub trait DeviceSet: Sync {
    /// The name of each kind, and the number of boards of it that may exist.
    const KINDS: &'static [(&'static str, u8)];

    /// The boards that interrupt, in the order of their vectors.
    const CHAIN: &'static [Link];

    /// Returns the records of vectors. The record of a vector is at the index of its first board in
    /// [`CHAIN`](Self::CHAIN), which has the same length.
    fn lines(&self) -> &[VectorRecord];

    /// Calls `visitor` with the board in a slot, with its type; returns `None` if there is no such
    /// board.
    fn visit<V: Visitor>(&self, slot: u16, visitor: V) -> Option<V::Output>;
}

/// The name of a device of the set `S` together with the type `D` of its driver, such as
/// `Boards::uart`. It is an argument of [`Switch::open_typed`](crate::Switch::open_typed) and
/// [`Switch::device`](crate::Switch::device). [`device_switch!`](crate::device_switch) makes a
/// constant of this type for each field.
pub struct DriverSlot<S, D> {
    number: u8,
    units: fn(&S) -> &[Unit<D>],
}

impl<S, D> Clone for DriverSlot<S, D> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<S, D> Copy for DriverSlot<S, D> {}

impl<S, D> DriverSlot<S, D> {
    #[doc(hidden)]
    #[must_use]
    pub const fn new(number: u8, units: fn(&S) -> &[Unit<D>]) -> Self {
        Self { number, units }
    }

    #[doc(hidden)]
    #[must_use]
    pub const fn number(&self) -> u16 {
        self.number as u16
    }

    /// The board in a slot; `None` if it is of another kind, or there is none.
    pub(crate) fn unit<'s>(&self, devices: &'s S, slot: u16) -> Option<&'s Unit<D>> {
        let units = (self.units)(devices);
        (slot >> BOARD == self.number()).then(|| units.get(usize::from(slot & MASK)))?
    }
}

/// Bits of a slot that number the board.
pub(crate) const BOARD: u32 = 6;
const MASK: u16 = (1 << BOARD) - 1;

/// The slot of a board.
pub(crate) const fn slot(kind: u8, board: u8) -> u16 {
    (kind as u16) << BOARD | board as u16
}

/// A board of a [`DeviceSet`] that interrupts, with its vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// The vector of the board.
    pub vector: InterruptVector,
    /// The slot of the board: `kind << 6 | board`.
    pub slot: u16,
}

/// A function that is generic over the driver of a board, for [`DeviceSet::visit`]; a closure
/// cannot be generic.
pub trait Visitor {
    /// The type of the function's result.
    type Output;

    /// Calls the function with a board.
    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output;
}

/// The slot and the place of board `number` among all boards of a set.
///
/// # Panics
/// If the set has too many: it does not compile.
const fn nth(kinds: &[(&str, &[Location])], mut number: usize) -> Option<(u16, Location)> {
    assert!(kinds.len() <= Entry::MOST, "a set has too many devices");
    let mut kind = 0;
    while kind < kinds.len() {
        let places = kinds[kind].1;
        assert!(places.len() <= Entry::MOST, "a device has too many boards");
        if number < places.len() {
            return Some((slot(kind as u8, number as u8), places[number]));
        }
        number -= places.len();
        kind += 1;
    }
    None
}

/// Returns how many of the boards in `kinds` have an interrupt.
#[doc(hidden)]
#[must_use]
pub const fn links(kinds: &[(&str, &[Location])]) -> usize {
    let (mut count, mut number) = (0, 0);
    while let Some((_, place)) = nth(kinds, number) {
        if place.interrupt().is_some() {
            count += 1;
        }
        number += 1;
    }
    count
}

/// Returns the boards in `kinds` that have an interrupt, sorted by vector. `N` is the result of
/// [`links`].
///
/// # Panics
/// If two boards have the same address, or share a vector at different levels; such a set does not
/// compile.
#[doc(hidden)]
#[must_use]
pub const fn chain<const N: usize>(kinds: &[(&str, &[Location])]) -> [Link; N] {
    let none = Link {
        vector: InterruptVector(0),
        slot: 0,
    };
    let mut chain = [none; N];
    let (mut count, mut number) = (0, 0);
    while let Some((slot, place)) = nth(kinds, number) {
        check(place, kinds, number);
        if let Some((vector, _)) = place.interrupt() {
            // Insertion from the end: boards of one vector stay in their order.
            let mut at = count;
            while at > 0 && chain[at - 1].vector.0 > vector.0 {
                chain[at] = chain[at - 1];
                at -= 1;
            }
            chain[at] = Link { vector, slot };
            count += 1;
        }
        number += 1;
    }
    chain
}

/// Compares a place with those of the boards before `number`.
const fn check(place: Location, kinds: &[(&str, &[Location])], number: usize) {
    let mut other = 0;
    while other < number
        && let Some((_, before)) = nth(kinds, other)
    {
        assert!(before.base() != place.base(), "two boards have one address");
        if let (Some((one, low)), Some((two, high))) = (place.interrupt(), before.interrupt()) {
            assert!(
                one.0 != two.0 || low.0 == high.0,
                "two boards of one vector have different levels"
            );
        }
        other += 1;
    }
}

/// Declares the devices for which a program is built, with the addresses at which boards may be and
/// with their interrupts: the system configuration file of A. I. Memo 977 (section 3.1).
///
/// ```
/// use condor_dev::drivers::Uart16550;
/// use condor_dev::{Location, device_switch};
///
/// device_switch! {
///     /// What the crate of a hand may hold.
///     pub struct HandDevices {
///         uart: Uart16550 = [
///             Location::at(0xee00_0000).interrupting(64, 3),
///             Location::at(0xee00_1000).interrupting(64, 3),
///         ],
///     }
/// }
///
/// static DEVICES: HandDevices = HandDevices::new();
/// ```
///
/// Each field is a device. [`open`](crate::Switch::open) opens it by the field's name, and the
/// constant of that name, here `HandDevices::uart`, opens it [with its
/// type](crate::Switch::open_typed). Several fields may have the same driver.
///
/// Two boards at the same address do not compile:
///
/// ```compile_fail
/// # use condor_dev::{Location, device_switch};
/// # use condor_dev::drivers::Uart16550;
/// device_switch! {
///     struct Twice {
///         uart: Uart16550 = [Location::at(0x1000), Location::at(0x1000)],
///     }
/// }
/// static DEVICES: Twice = Twice::new();
/// ```
///
/// Nor do boards that share a vector at different levels:
///
/// ```compile_fail
/// # use condor_dev::{Location, device_switch};
/// # use condor_dev::drivers::Uart16550;
/// device_switch! {
///     struct Uneven {
///         uart: Uart16550 = [
///             Location::at(0x1000).interrupting(64, 3),
///             Location::at(0x2000).interrupting(64, 4),
///         ],
///     }
/// }
/// static DEVICES: Uneven = Uneven::new();
/// ```
///
/// Nor does an I2C address that no part of the driver can have, such as 0x70, at which all PCA9685
/// of a bus answer after power-on:
///
/// ```compile_fail
/// # use condor_dev::{Location, device_switch};
/// # use condor_dev::drivers::Pca9685;
/// device_switch! {
///     struct All {
///         servos: Pca9685 = [Location::i2c(0x70)],
///     }
/// }
/// ```
#[macro_export]
macro_rules! device_switch {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $set:ident {
            $($device:ident: $driver:ty = [$($place:expr),+ $(,)?]),+ $(,)?
        }
    ) => {
        $(#[$attribute])*
        $visibility struct $set {
            $($device: [$crate::Unit<$driver>; <[$crate::Location]>::len(&[$($place),+])],)+
            lines: [$crate::set::VectorRecord; Self::LINKS.len()],
        }

        impl $set {
            const PLACES: &'static [(&'static str, &'static [$crate::Location])] =
                &[$((stringify!($device), &[$($place),+]),)+];
            const LINKS: [$crate::set::Link; $crate::set::links(Self::PLACES)] =
                $crate::set::chain(Self::PLACES);

            /// Makes the set; `start` has not looked for its boards yet.
            #[must_use]
            $visibility const fn new() -> Self {
                Self {
                    $($device: [$($crate::Unit::new($place)),+],)+
                    lines: [const { $crate::set::VectorRecord::new() }; Self::LINKS.len()],
                }
            }
        }

        const _: () = {
            $($($crate::Unit::<$driver>::check($place);)+)+
        };

        const _: () = {
            #[allow(non_camel_case_types)]
            enum Number {
                $($device),+
            }

            impl $set {
                $(
                    #[doc = concat!("The boards of `", stringify!($device), "`.")]
                    #[allow(non_upper_case_globals)]
                    $visibility const $device: $crate::DriverSlot<Self, $driver> =
                        $crate::DriverSlot::new(Number::$device as u8, |set| &set.$device);
                )+
            }
        };

        impl $crate::set::DeviceSet for $set {
            const KINDS: &'static [(&'static str, u8)] = &[
                $((stringify!($device), <[$crate::Location]>::len(&[$($place),+]) as u8),)+
            ];
            const CHAIN: &'static [$crate::set::Link] = &Self::LINKS;

            fn lines(&self) -> &[$crate::set::VectorRecord] {
                &self.lines
            }

            #[inline(always)]
            fn visit<V: $crate::set::Visitor>(&self, slot: u16, visitor: V) -> Option<V::Output> {
                let (kind, board) = (slot >> 6, usize::from(slot & 63));
                $(
                    if kind == const { <$set>::$device.number() } {
                        return self.$device.get(board).map(|unit| visitor.board(unit));
                    }
                )+
                None
            }
        }
    };
}
