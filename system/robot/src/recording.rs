//! Recordings: all that a servo processor's controllers are given, tick by tick, as a file.
//!
//! A [servo](crate::servo) with the argument `record=FILE` makes one, and [`replay`](crate::replay)
//! computes the same outputs from it again, on any target. A recording begins with the first tick
//! of a program's incarnation, so that the state of the controllers before it is known.
//!
//! # The file
//!
//! It is an MCAP file without chunks, whose messages are little-endian CDR, and which has their types.
//! Metadata of the name `condor-servo` come before all messages: the version of the format (6), the
//! number of the processor, ticks in a second, fingers of the hand, joints and actuators of a
//! finger. A message
//! has the number of its tick, from 0, as its sequence number, and that number divided by the rate as
//! its log time: the time since the first tick, if no release was skipped.
//!
//! | channel | topic | a message has |
//! |---|---|---|
//! | 1 | `/servo/tick` | the time since the last tick as the loop took it; the counts of 52 inputs: of each finger the positions of the joints, the efforts of the actuators, and the force at the tip, without those that have no sensor, one after another; a bit for each that could not be read, whose counts are 0 |
//! | 2 | `/servo/palm` | its acceleration from this tick on; 0 before the first |
//! | 3 | `/servo/order` | the number of a grasp's order, a [`GraspOrder`](condor_hand::grasp::distributed::GraspOrder) |
//! | 4 | `/servo/others` | the [`Joints`](crate::grasp::Joints) of the fingers on other servo processors in the tick before, as far as the law of a grasp heard them |
//! | 5 | `/servo/asked` | the finger; a [`FingerRequest`](crate::message::FingerRequest) in the format of postcard, in words |
//! | 6 | `/servo/done` | the counts of 32 outputs: the actuators of each finger; the hash |
//! | 7 | `/servo/end` | how many ticks there were |
//!
//! The values of a finger on another processor are 0. A tick consists of one message of channel 1,
//! messages of channels 2 to 5 as needed, and one message of channel 6. The hash is the FNV-1a of 64
//! bits over the [outputs](ServoOutputs) of all ticks so far. A file without a message of channel 7 was
//! broken off; other programs can read it all the same.

use core::fmt;

use condor_dev::stdio::WriteError;
use condor_fs::{Errno, FileError};
use condor_hand::grasp::distributed::GraspInputs;
use condor_mcap::McapError;
use thiserror::Error;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{ACTUATORS, FINGERS, JOINTS};

mod channel;
mod fnv;
mod head;
mod record;
mod rows;
mod tape;

pub(crate) use fnv::Fnv;
pub(crate) use head::Head;
pub(crate) use record::{Recorder, Ring, TapeState};
pub(crate) use rows::{Row, Rows};
pub(crate) use tape::Tape;

/// Inputs of a finger: positions of joints, efforts of actuators, the force at the tip, and positions of actuators.
pub(crate) const INPUTS_OF_FINGER: usize = JOINTS + 2 * ACTUATORS + 1;
/// The number of inputs of a servo processor in a recording: for each finger the positions of the joints, the efforts of
/// the actuators, the force at the tip, and the positions of the actuators, as far as sensors measure them.
pub const INPUTS: usize = INPUTS_OF_FINGER * FINGERS;
/// The number of outputs of a servo processor in a recording: the commands of the actuators of each finger.
pub const OUTPUTS: usize = ACTUATORS * FINGERS;

/// The counts of the converters of a servo processor's sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(crate) struct Inputs {
    counts: [u16; INPUTS],
    missing: [u64; INPUTS.div_ceil(64)],
}

impl Inputs {
    /// An input's counts, of at most 16 bits.
    pub(crate) fn set(&mut self, number: usize, counts: Option<u32>) {
        if let Some(place) = self.counts.get_mut(number) {
            *place = counts.unwrap_or(0) as u16;
        }
        if let Some(missing) = self.missing.get_mut(number / 64) {
            *missing |= u64::from(counts.is_none()) << (number % 64);
        }
    }

    pub(crate) fn get(&self, number: usize) -> Option<u32> {
        let counts = self.counts.get(number)?;
        let missing = self.missing.get(number / 64)?;
        (missing >> (number % 64) & 1 == 0).then_some((*counts).into())
    }
}

/// The inputs of the controllers in a tick besides measurements and requests by message.
#[derive(Clone, Debug)]
pub(crate) struct TickInputs {
    /// The time since the last tick, s; for the first one, a period.
    pub(crate) period_s: f64,
    /// That of the palm, in its own axes, m/s².
    pub(crate) acceleration: [f64; 3],
    pub(crate) grasp: GraspInputs<FINGERS, JOINTS>,
}

/// The outputs of a servo processor in one tick, in this order: for each finger, its actuators.
///
/// The outputs of a finger on another processor are 0. A replay writes one `ServoOutputs` per tick to its file: 320
/// bytes, little-endian.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct ServoOutputs {
    /// The counts of the digital-to-analog converters.
    pub counts: [u16; OUTPUTS],
    /// The efforts that the actuators are to have, N or N m.
    pub command: [f64; OUTPUTS],
}

/// The message that ends a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(crate) struct TickEnd {
    pub(crate) counts: [u16; OUTPUTS],
    pub(crate) hash: u64,
}

/// The reason why a servo processor cannot make a recording, or why a recording cannot be replayed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ServoRecordingError {
    /// The file service failed.
    #[error(transparent)]
    File(#[from] FileError),
    /// The memory in which ticks wait to be written cannot be accessed.
    #[error(transparent)]
    Access(#[from] condor_mbox::AccessError),
    /// The file is not an MCAP file, or is one that a processor cannot read.
    #[error("cannot read the recording after {ticks} ticks: {error}")]
    Mcap {
        /// The number of whole ticks before the problem.
        ticks: u32,
        /// The reason.
        error: McapError<FileError>,
    },
    /// The file is another one, or has another version of the format.
    #[error(
        "it is not a recording of this version: its {name} is {}, not {wanted}",
        FoundVersion(found)
    )]
    Head {
        /// The name of the number in its metadata.
        name: &'static str,
        /// The number; `None` if there is none.
        found: Option<u32>,
        /// The number that a recording of this version has.
        wanted: u32,
    },
    /// The configuration has another rate.
    #[error(
        "it was recorded at {recorded_hz} Hz, but processor {processor} of this configuration runs at \
         {configured_hz} Hz"
    )]
    Rate {
        /// Ticks in a second of the recording, Hz.
        recorded_hz: u32,
        /// The number of the processor.
        processor: u8,
        /// Ticks in a second in the configuration, Hz.
        configured_hz: u32,
    },
    /// The file ends before its recording does.
    #[error("the recording is incomplete: it ends after {ticks} ticks")]
    BrokenOff {
        /// The number of whole ticks that are in the file.
        ticks: u32,
    },
    /// A message has an unknown channel, a wrong place or a wrong length.
    #[error(
        "after {ticks} ticks there is an unexpected message, of channel {channel} with {bytes} bytes: \
         record again"
    )]
    Message {
        /// The number of whole ticks before the message.
        ticks: u32,
        /// The channel of the message.
        channel: u16,
        /// The length of the message, bytes.
        bytes: usize,
    },
    /// Ticks came faster than the file service wrote them.
    #[error(
        "the recording ended early, after {ticks} ticks: the file service wrote too slowly for this loop"
    )]
    Behind {
        /// The number of whole ticks that are in the file.
        ticks: u32,
    },
    /// The outputs are not those of the recorded run.
    #[error("tick {tick} differs from the recording: {difference}")]
    Differs {
        /// The first tick that differs, from 0.
        tick: u32,
        /// The first output that differs, with its counts.
        difference: Difference,
    },
}

impl From<WriteError<FileError>> for ServoRecordingError {
    fn from(error: WriteError<FileError>) -> Self {
        Self::File(match error {
            WriteError::Writer(error) => error,
            WriteError::Zero => Errno::IO.into(),
        })
    }
}

struct FoundVersion<'a>(&'a Option<u32>);

impl fmt::Display for FoundVersion<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(found) => found.fmt(f),
            None => f.write_str("missing"),
        }
    }
}

/// The difference between the outputs of one tick in a recording and in its replay. Its text names the first output
/// whose counts differ, with both counts, or says that only the efforts differ.
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
            Some((output, was, is)) => {
                write!(f, "output {output} had {was} counts, and now has {is}")
            }
            None => f.write_str("the counts are equal, but efforts differ in some bits"),
        }
    }
}
