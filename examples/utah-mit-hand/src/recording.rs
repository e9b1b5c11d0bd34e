//! Recordings: all that a servo processor's controllers are given, tick by tick, as a file.
//!
//! A [servo](crate::servo) with the argument `record=FILE` makes one, and [`replay`](crate::replay)
//! computes the same outputs from it again, on any target. A recording begins with the first tick
//! of a program's life, so that the state of the controllers before it is known.
//!
//! # The file
//!
//! All numbers are little-endian. First come 24 bytes: "CREC", the version of the format (3), the
//! number of the processor, ticks in a second, fingers of the hand (4) and joints of a finger (4), each 32 bits. Then come records: a word of 32 bits, kind in its lowest 8 bits and
//! length of what follows in words in the others.
//!
//! | kind | words | what follows |
//! |---|---|---|
//! | 1 tick | 30 | the time since the last tick as the loop took it, s (64 bits); the counts of 52 inputs (16 bits each): of each finger position, flexor and extensor of each joint, and the force at the tip; a bit for each that could not be read, its counts are 0 (64 bits) |
//! | 2 palm | 6 | its acceleration from this tick on, m/s² (3 of 64 bits); 0 before the first |
//! | 3 order | 200 | the number of a grasp's order (64 bits), a [`GraspOrder`](condor_hand::grasp::distributed::GraspOrder) in words |
//! | 4 others | 78 | the [`Joints`](crate::grasp::Joints) of the fingers on other servo processors in the tick before, as far as the law of a grasp heard them |
//! | 5 asked | | the finger; an [`Asked`](condor_hand::message::Asked) in words |
//! | 6 done | 18 | the counts of 32 outputs (16 bits each): of each finger and joint flexor, extensor; the hash (64 bits) |
//! | 7 end | 1 | how many ticks there were |
//!
//! The values of a finger on another processor are 0. A tick consists of one record of kind 1,
//! records of kinds 2 to 5 as needed, and one record of kind 6. The hash is the FNV-1a of 64 bits
//! over the [outputs](Output) of all ticks so far. A file without a record of kind 7 was broken
//! off.

use core::fmt;

use condor_fs::Error as FileError;
use condor_hand::grasp::distributed::GraspInputs;
use thiserror::Error;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS};

mod fnv;
mod record;
mod rows;
mod tape;

pub(crate) use fnv::Fnv;
pub(crate) use record::{Recorder, Ring};
pub(crate) use rows::{Row, Rows};
pub(crate) use tape::Tape;

/// Inputs of a finger: position and two tensions of each joint, and the force at the tip.
pub(crate) const INPUTS_OF_FINGER: usize = 3 * JOINTS + 1;
/// Inputs of a servo processor.
pub const INPUTS: usize = INPUTS_OF_FINGER * FINGERS;
/// Outputs of a servo processor: two tensions of each joint.
pub const OUTPUTS: usize = 2 * JOINTS * FINGERS;

const MAGIC: u32 = u32::from_le_bytes(*b"CREC");
const VERSION: u32 = 3;

mod kind {
    pub(super) const TICK: u32 = 1;
    pub(super) const PALM: u32 = 2;
    pub(super) const ORDER: u32 = 3;
    pub(super) const OTHERS: u32 = 4;
    pub(super) const ASKED: u32 = 5;
    pub(super) const DONE: u32 = 6;
    pub(super) const END: u32 = 7;
}

/// The beginning of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(crate) struct Head {
    magic: u32,
    version: u32,
    pub(crate) processor: u32,
    pub(crate) rate_hz: u32,
    fingers: u32,
    joints: u32,
}

impl Head {
    pub(crate) const fn new(processor: u8, rate_hz: u32) -> Self {
        Self {
            magic: MAGIC,
            version: VERSION,
            processor: processor as u32,
            rate_hz,
            fingers: FINGERS as u32,
            joints: JOINTS as u32,
        }
    }
}

/// What the converters of a servo processor's sensors show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(crate) struct Inputs {
    counts: [u16; INPUTS],
    missing: u64,
}

impl Inputs {
    /// An input's counts, of at most 16 bits.
    pub(crate) fn set(&mut self, number: usize, counts: Option<u32>) {
        if let Some(place) = self.counts.get_mut(number) {
            *place = counts.unwrap_or(0) as u16;
            self.missing |= u64::from(counts.is_none()) << number;
        }
    }

    pub(crate) fn get(&self, number: usize) -> Option<u32> {
        let counts = self.counts.get(number)?;
        (self.missing >> number & 1 == 0).then_some((*counts).into())
    }
}

/// What the controllers are given in a tick besides what is measured and what messages ask for.
#[derive(Clone, Debug)]
pub(crate) struct Given {
    /// The time since the last tick, s; for the first one, a period.
    pub(crate) period_s: f64,
    /// That of the palm, in its own axes, m/s².
    pub(crate) acceleration: [f64; 3],
    pub(crate) grasp: GraspInputs<FINGERS, JOINTS>,
}

/// The outputs of a servo processor in a tick: for each finger and joint, flexor and extensor.
///
/// The outputs of a finger on another processor are 0. A replay writes one `Output` per tick, 320
/// bytes, little-endian.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Output {
    /// The counts of the digital-to-analog converters.
    pub counts: [u16; OUTPUTS],
    /// The tensions that the actuators are to have, N.
    pub command: [f64; OUTPUTS],
}

/// What ends a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(crate) struct Done {
    pub(crate) counts: [u16; OUTPUTS],
    pub(crate) hash: u64,
}

/// The reason for which a recording cannot be made or replayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file service.
    #[error(transparent)]
    File(#[from] FileError),
    /// The memory in which ticks wait to be written.
    #[error(transparent)]
    Access(#[from] condor_mbox::AccessError),
    /// Another file, or another version of the format.
    #[error("it is no recording of this version: its head is {found:x?}, not {wanted:x?}")]
    Head {
        /// The words at the beginning, without processor and rate.
        found: [u32; 4],
        /// These words in a recording of this version.
        wanted: [u32; 4],
    },
    /// A configuration with another rate.
    #[error(
        "it was recorded at {recorded_hz} Hz, and processor {processor} of this configuration runs \
         at {configured_hz} Hz"
    )]
    Rate {
        /// Ticks in a second of the recording, Hz.
        recorded_hz: u32,
        /// The processor.
        processor: u8,
        /// Ticks in a second in the configuration, Hz.
        configured_hz: u32,
    },
    /// A file that ends before its recording does.
    #[error("it was broken off after {ticks} ticks")]
    BrokenOff {
        /// The whole ticks that are in it.
        ticks: u32,
    },
    /// A record has an unknown kind, or is in a wrong place.
    #[error("after {ticks} ticks there is a record of kind {kind} and {words} words")]
    Record {
        /// The whole ticks before it.
        ticks: u32,
        /// Its kind.
        kind: u32,
        /// How long it is, in words.
        words: u32,
    },
    /// Ticks that came faster than the file service wrote them.
    #[error("it was broken off after {ticks} ticks: the file service did not keep up")]
    Behind {
        /// The whole ticks that are in it.
        ticks: u32,
    },
    /// The outputs are not those of the recorded run.
    #[error("tick {tick} put out {difference}")]
    Differs {
        /// The first tick that differs, from 0.
        tick: u32,
        /// The difference.
        difference: Difference,
    },
}

/// The difference between the recorded and the computed outputs of a tick: the first output whose
/// counts differ, with both counts; `None` if only the tensions differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference(Option<(u32, u16, u16)>);

impl Difference {
    pub(crate) fn of(was: &[u16; OUTPUTS], is: &[u16; OUTPUTS]) -> Self {
        let mut outputs = (0..).zip(was.iter().zip(is));
        let first = outputs.find(|(_, (was, is))| was != is);
        Self(first.map(|(output, (was, is))| (output, *was, *is)))
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some((output, was, is)) => write!(
                f,
                "{was} counts at output {output} when it was recorded, and {is} now"
            ),
            None => f.write_str("the same counts for tensions of other bits"),
        }
    }
}
