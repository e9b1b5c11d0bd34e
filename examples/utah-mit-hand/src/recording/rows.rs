//! [`Rows`]: the ticks of a recording, one after another.

use condor_fs::Error as FileError;
use condor_hand::grasp::distributed::{GraspInputs, GraspOrder};
use condor_hand::message::Asked;
use embedded_io::Read;
use zerocopy::{FromBytes, FromZeros, Immutable, IntoBytes};

use super::{Done, Given, Head, Inputs, RecordingError, kind};
use crate::grasp::Joints;
use crate::{FINGERS, JOINTS};

/// Bytes of the longest record: that of an order, with its number.
const BYTES: usize = 8 + 4 * GraspOrder::<FINGERS>::WORDS;
/// What can be asked of all fingers in a tick: of each joint gains, and a mode or a target; of each
/// finger a restart and set-points.
const ASKED: usize = FINGERS * (2 * JOINTS + 2);

/// A tick of a recording.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) inputs: Inputs,
    pub(crate) given: Given,
    /// With the finger.
    pub(crate) asked: heapless::Vec<(usize, Asked<JOINTS>), ASKED>,
    pub(crate) done: Done,
}

/// A recording that is read.
pub(crate) struct Rows<R> {
    file: R,
    ticks: u32,
    acceleration: [f64; 3],
}

/// A record: its kind, and what follows, with zeros after it.
struct Record {
    kind: u32,
    len: usize,
    bytes: [u8; BYTES],
}

/// What a record of kind 1 has.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Tick {
    period_s: f64,
    inputs: Inputs,
}

impl<R: Read<Error = FileError>> Rows<R> {
    /// # Errors
    /// The file's; a file that is no recording.
    pub(crate) fn new(mut file: R) -> Result<(Head, Self), RecordingError> {
        let mut head = Head::new_zeroed();
        // What is shorter is not that either.
        fill(&mut file, head.as_mut_bytes())?;
        let essence = |head: &Head| [head.magic, head.version, head.fingers, head.joints];
        let (found, wanted) = (essence(&head), essence(&Head::new(0, 0)));
        if found != wanted {
            return Err(RecordingError::Head { found, wanted });
        }
        let rows = Self {
            file,
            ticks: 0,
            acceleration: [0.0; 3],
        };
        Ok((head, rows))
    }

    /// How many ticks there were until now.
    pub(crate) const fn ticks(&self) -> u32 {
        self.ticks
    }

    /// The next tick; none at the end.
    ///
    /// # Errors
    /// The file's; what is no recording, or a part of one.
    pub(crate) fn next(&mut self) -> Result<Option<Row>, RecordingError> {
        let first = self.record()?;
        if first.kind == kind::END {
            let ticks: u32 = self.whole(&first)?;
            return if ticks == self.ticks {
                Ok(None)
            } else {
                Err(self.wrong(&first))
            };
        }
        if first.kind != kind::TICK {
            return Err(self.wrong(&first));
        }
        let Tick { period_s, inputs } = self.whole(&first)?;
        let mut grasp = GraspInputs::default();
        let mut asked = heapless::Vec::new();
        loop {
            let record = self.record()?;
            match record.kind {
                kind::PALM => self.acceleration = self.whole(&record)?,
                kind::ORDER => {
                    let order = record.order();
                    grasp.order = Some(order.ok_or_else(|| self.wrong(&record))?);
                }
                kind::OTHERS => {
                    grasp.others = Some(self.whole::<Joints>(&record)?.of_hand());
                }
                kind::ASKED => {
                    let one = record.asked().ok_or_else(|| self.wrong(&record))?;
                    asked.push(one).map_err(|_| self.wrong(&record))?;
                }
                kind::DONE => {
                    let done = self.whole(&record)?;
                    self.ticks = self.ticks.saturating_add(1);
                    let given = Given {
                        period_s,
                        acceleration: self.acceleration,
                        grasp,
                    };
                    return Ok(Some(Row {
                        inputs,
                        given,
                        asked,
                        done,
                    }));
                }
                _ => return Err(self.wrong(&record)),
            }
        }
    }

    fn record(&mut self) -> Result<Record, RecordingError> {
        let ticks = self.ticks;
        let mut head = [0; 4];
        if !fill(&mut self.file, &mut head)? {
            return Err(RecordingError::BrokenOff { ticks });
        }
        let head = u32::from_le_bytes(head);
        let (kind, words) = (head & 0xff, head >> 8);
        let mut record = Record {
            kind,
            len: words as usize * 4,
            bytes: [0; BYTES],
        };
        let Some(bytes) = record.bytes.get_mut(..record.len) else {
            return Err(RecordingError::Record { ticks, kind, words });
        };
        if !fill(&mut self.file, bytes)? {
            return Err(RecordingError::BrokenOff { ticks });
        }
        Ok(record)
    }

    /// A record as a `T`, which it must be as long as.
    fn whole<T: FromBytes>(&self, record: &Record) -> Result<T, RecordingError> {
        let bytes = record.bytes.get(..record.len).unwrap_or(&[]);
        T::read_from_bytes(bytes).map_err(|_| self.wrong(record))
    }

    const fn wrong(&self, record: &Record) -> RecordingError {
        RecordingError::Record {
            ticks: self.ticks,
            kind: record.kind,
            words: record.len as u32 / 4,
        }
    }
}

impl Record {
    fn words(&self) -> [u32; BYTES / 4] {
        let (all, _) = self.bytes.as_chunks::<4>();
        let mut words = [0; BYTES / 4];
        for (word, bytes) in words.iter_mut().zip(all) {
            *word = u32::from_le_bytes(*bytes);
        }
        words
    }

    /// An order and its number; none if this is not as long.
    fn order(&self) -> Option<(u64, GraspOrder<FINGERS>)> {
        let [low, high, order @ ..] = self.words();
        let number = u64::from(high) << 32 | u64::from(low);
        (self.len == BYTES).then(|| (number, GraspOrder::take(&order)))
    }

    fn asked(&self) -> Option<(usize, Asked<JOINTS>)> {
        let words = self.words();
        let (finger, asked) = words.get(..self.len / 4)?.split_first()?;
        let finger = usize::try_from(*finger).ok().filter(|&it| it < FINGERS)?;
        Some((finger, Asked::take(asked)?))
    }
}

/// Reads until `into` is full; false if the file ends before.
fn fill<R: Read>(file: &mut R, into: &mut [u8]) -> Result<bool, R::Error> {
    let mut rest = into;
    while !rest.is_empty() {
        rest = match file.read(rest)? {
            0 => return Ok(false),
            count => rest.get_mut(count..).unwrap_or_default(),
        };
    }
    Ok(true)
}
