//! [`DeviceSet`]: the devices that a program was built for.

#[doc(hidden)]
pub use crate::dispatch::Line;

use crate::driver::Driver;
use crate::fd::Entry;
use crate::interrupt::{Level, Vector};
use crate::unit::{Place, Unit};

/// The boards that may exist, kind by kind; [`device_switch!`](crate::device_switch) writes it.
///
/// Kinds and boards are numbered from 0 in the order in which they are named there.
pub trait DeviceSet: Sync {
    /// Name of each kind, and how many boards of it may exist.
    const KINDS: &'static [(&'static str, u8)];

    /// The boards that interrupt, in the order of their vectors.
    const CHAIN: &'static [Link];

    /// What the entry of interrupts notes of each vector, at the place of its first board in
    /// [`CHAIN`](Self::CHAIN), which is as long.
    fn lines(&self) -> &[Line];

    /// Shows one board to `visitor`, with its type; `None` if there is no such board.
    fn visit<V: Visitor>(&self, kind: u8, board: u8, visitor: V) -> Option<V::Output>;

    /// The same, where the boards of all kinds are numbered on: the way of every transfer, in
    /// which there is one number to compare.
    fn visit_slot<V: Visitor>(&self, slot: u16, visitor: V) -> Option<V::Output>;
}

/// The slot of the first board of a kind; of the end, for the number after the last kind.
#[doc(hidden)]
#[must_use]
pub const fn first_slot(kinds: &[(&str, u8)], kind: u8) -> u16 {
    let mut slot = 0;
    let mut before = 0;
    while before < kind as usize && before < kinds.len() {
        slot += kinds[before].1 as u16;
        before += 1;
    }
    slot
}

/// The quarter of the kinds that a kind is in.
#[doc(hidden)]
#[must_use]
pub const fn quarter(kinds: &[(&str, u8)], kind: u8) -> usize {
    4 * kind as usize / kinds.len()
}

/// The first slots of the second, third and last quarter of the kinds.
#[doc(hidden)]
#[must_use]
pub const fn quarters(kinds: &[(&str, u8)]) -> [u16; 3] {
    let mut first = [0; 3];
    let mut kind = 0;
    while kind < kinds.len() {
        let mut later = quarter(kinds, kind as u8);
        // Where its quarter ends at the earliest, all later ones begin.
        while later < 3 {
            first[later] = first_slot(kinds, kind as u8 + 1);
            later += 1;
        }
        kind += 1;
    }
    first
}

/// The boards of one driver in a set.
pub trait Has<D: Driver>: DeviceSet {
    /// Its kind.
    const KIND: u8;

    /// The boards.
    fn units(&self) -> &[Unit<D>];
}

/// A board that interrupts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// Its vector.
    pub vector: Vector,
    /// Its kind.
    pub kind: u8,
    /// Its board number.
    pub board: u8,
}

/// A function of a board, whatever its driver is.
pub trait Visitor {
    /// What it gives.
    type Output;

    /// Sees the board.
    fn board<D: Driver>(self, unit: &Unit<D>) -> Self::Output;
}

/// How many of the places interrupt.
#[doc(hidden)]
#[must_use]
pub const fn links(kinds: &[(&str, &[Place])]) -> usize {
    let mut count = 0;
    let mut kind = 0;
    while kind < kinds.len() {
        let places = kinds[kind].1;
        let mut board = 0;
        while board < places.len() {
            if places[board].interrupt().is_some() {
                count += 1;
            }
            board += 1;
        }
        kind += 1;
    }
    count
}

/// The places that interrupt, in the order of their vectors. Nothing may be named twice, and a vector
/// has one level.
///
/// # Panics
/// If something is: the set does not compile.
#[doc(hidden)]
#[must_use]
pub const fn chain<const N: usize>(kinds: &[(&str, &[Place])]) -> [Link; N] {
    assert!(
        kinds.len() <= Entry::MOST,
        "a set has too many kinds of devices"
    );
    let none = Link {
        vector: Vector(0),
        kind: 0,
        board: 0,
    };
    let mut chain = [none; N];
    let mut count = 0;
    let mut kind = 0;
    while kind < kinds.len() {
        let (name, places) = kinds[kind];
        assert!(
            places.len() <= Entry::MOST,
            "a set has too many boards of one kind"
        );
        let mut other = 0;
        while other < kind {
            assert!(!equal(name, kinds[other].0), "two devices have one name");
            other += 1;
        }
        let mut board = 0;
        while board < places.len() {
            let place = places[board];
            assert!(
                !comes_before(place, kinds, kind, board),
                "two boards have one address"
            );
            if let Some((vector, level)) = place.interrupt() {
                assert!(
                    !differs_in_level(vector, level, kinds),
                    "two boards of one vector have different levels"
                );
                // Insertion from the end: boards of one vector stay in their order.
                let mut at = count;
                while at > 0 && chain[at - 1].vector.0 > vector.0 {
                    chain[at] = chain[at - 1];
                    at -= 1;
                }
                chain[at] = Link {
                    vector,
                    kind: kind as u8,
                    board: board as u8,
                };
                count += 1;
            }
            board += 1;
        }
        kind += 1;
    }
    chain
}

/// Whether a board named before `board` of `kind` has the address of `place`.
const fn comes_before(place: Place, kinds: &[(&str, &[Place])], kind: usize, board: usize) -> bool {
    let mut other_kind = 0;
    while other_kind <= kind {
        let others = kinds[other_kind].1;
        let end = if other_kind == kind {
            board
        } else {
            others.len()
        };
        let mut other = 0;
        while other < end {
            if others[other].base() == place.base() {
                return true;
            }
            other += 1;
        }
        other_kind += 1;
    }
    false
}

/// Whether a board interrupts with `vector`, but not at `level`.
const fn differs_in_level(vector: Vector, level: Level, kinds: &[(&str, &[Place])]) -> bool {
    let mut kind = 0;
    while kind < kinds.len() {
        let places = kinds[kind].1;
        let mut board = 0;
        while board < places.len() {
            if let Some((other, its)) = places[board].interrupt()
                && other.0 == vector.0
                && its.0 != level.0
            {
                return true;
            }
            board += 1;
        }
        kind += 1;
    }
    false
}

const fn equal(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    a.len() == b.len() && at == a.len()
}

/// Names the devices that a program is built for, where their boards may be and how they
/// interrupt: the system configuration file of the memo (section 3.1).
///
/// ```
/// use condor_dev::drivers::Adc16;
/// use condor_dev::{Place, device_switch};
///
/// device_switch! {
///     /// What the crate of a hand may hold.
///     pub struct HandDevices {
///         adc: Adc16 = [
///             Place::at(0xee00_0000).interrupting(64, 3),
///             Place::at(0xee00_1000).interrupting(64, 3),
///         ],
///     }
/// }
///
/// static DEVICES: HandDevices = HandDevices::new();
/// ```
///
/// Two boards at one address, two devices of one name, or one driver named twice do not compile:
///
/// ```compile_fail
/// # use condor_dev::{Place, device_switch, drivers::Adc16};
/// device_switch! {
///     struct Twice {
///         adc: Adc16 = [Place::at(0x1000), Place::at(0x1000)],
///     }
/// }
/// static DEVICES: Twice = Twice::new();
/// ```
///
/// Nor do boards that share a vector at different levels:
///
/// ```compile_fail
/// # use condor_dev::{Place, device_switch, drivers::Adc16};
/// device_switch! {
///     struct Uneven {
///         adc: Adc16 = [
///             Place::at(0x1000).interrupting(64, 3),
///             Place::at(0x2000).interrupting(64, 4),
///         ],
///     }
/// }
/// static DEVICES: Uneven = Uneven::new();
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
            $($device: [$crate::Unit<$driver>; <[$crate::Place]>::len(&[$($place),+])],)+
            lines: [$crate::set::Line; Self::LINKS.len()],
        }

        impl $set {
            const PLACES: &'static [(&'static str, &'static [$crate::Place])] = &[
                $((<$driver as $crate::Driver>::NAME, &[$($place),+]),)+
            ];
            const NAMES: &'static [(&'static str, u8)] = &[
                $((<$driver as $crate::Driver>::NAME, <[$crate::Place]>::len(&[$($place),+]) as u8),)+
            ];
            const LINKS: [$crate::set::Link; $crate::set::links(Self::PLACES)] =
                $crate::set::chain(Self::PLACES);

            /// The boards, not looked for yet.
            #[must_use]
            $visibility const fn new() -> Self {
                Self {
                    $($device: [$($crate::Unit::new($place)),+],)+
                    lines: [const { $crate::set::Line::new() }; Self::LINKS.len()],
                }
            }
        }

        impl $crate::set::DeviceSet for $set {
            const KINDS: &'static [(&'static str, u8)] = Self::NAMES;
            const CHAIN: &'static [$crate::set::Link] = &Self::LINKS;

            fn lines(&self) -> &[$crate::set::Line] {
                &self.lines
            }

            #[inline(always)]
            fn visit<V: $crate::set::Visitor>(
                &self,
                kind: u8,
                board: u8,
                visitor: V,
            ) -> Option<V::Output> {
                let board = usize::from(board);
                $(
                    if kind == <Self as $crate::set::Has<$driver>>::KIND {
                        return self.$device.get(board).map(|unit| visitor.board(unit));
                    }
                )+
                None
            }

            #[inline(always)]
            fn visit_slot<V: $crate::set::Visitor>(
                &self,
                slot: u16,
                visitor: V,
            ) -> Option<V::Output> {
                // Quartered first, so that the last kind is not much dearer than the first.
                const QUARTERS: [u16; 3] = $crate::set::quarters(<$set>::NAMES);
                if slot < QUARTERS[1] {
                    if slot < QUARTERS[0] {
                        $crate::device_switch!(@chain self $set 0 slot visitor $($device: $driver,)+)
                    } else {
                        $crate::device_switch!(@chain self $set 1 slot visitor $($device: $driver,)+)
                    }
                } else if slot < QUARTERS[2] {
                    $crate::device_switch!(@chain self $set 2 slot visitor $($device: $driver,)+)
                } else {
                    $crate::device_switch!(@chain self $set 3 slot visitor $($device: $driver,)+)
                }
            }
        }

        $crate::device_switch!(@kinds $set [] $($device: $driver,)+);
    };
    // The kinds of one quarter, in turn; the others are gone when the program is compiled.
    (@chain $self:ident $set:ident $quarter:literal $slot:ident $visitor:ident
        $($device:ident: $driver:ty,)+) => {{
        $({
            const KIND: u8 = <$set as $crate::set::Has<$driver>>::KIND;
            const FIRST: u16 = $crate::set::first_slot(<$set>::NAMES, KIND);
            const END: u16 = $crate::set::first_slot(<$set>::NAMES, KIND + 1);
            if const { $crate::set::quarter(<$set>::NAMES, KIND) == $quarter } && $slot < END {
                let unit = $self.$device.get(usize::from($slot.wrapping_sub(FIRST)));
                return unit.map(|unit| $visitor.board(unit));
            }
        })+
        None
    }};
    (@kinds $set:ident [$($before:ident)*] $device:ident: $driver:ty, $($rest:tt)*) => {
        impl $crate::set::Has<$driver> for $set {
            const KIND: u8 = $crate::device_switch!(@count $($before)*);

            #[inline(always)]
            fn units(&self) -> &[$crate::Unit<$driver>] {
                &self.$device
            }
        }

        $crate::device_switch!(@kinds $set [$($before)* $device] $($rest)*);
    };
    (@kinds $set:ident [$($before:ident)*]) => {};
    (@count $($device:ident)*) => { 0 $(+ { let _ = stringify!($device); 1 })* };
}
