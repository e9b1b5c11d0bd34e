//! [`Rows`]: the ticks of a recording, one after another.

use condor_fs::FileError;
use condor_hand::grasp::distributed::{GraspInputs, GraspOrder};
use condor_mcap::{McapError, McapReader, McapRecord};
use embedded_io::Read;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::head::METADATA;
use super::{Head, Inputs, ServoRecordingError, TickEnd, TickInputs, channel};
use crate::grasp::Joints;
use crate::message::FingerRequest;
use crate::{FINGERS, JOINTS};

/// Words of the longest message: that of an order, with its number.
const WORDS: usize = 2 + size_of::<GraspOrder>() / 4;
/// Room for a record: that of the longest message and what comes before it; schemas are shorter.
const RECORD: usize = 64 + 4 * WORDS;
/// The largest number of requests in a tick: of each joint gains, and a mode or a target; of each finger a
/// restart and set-points.
const ASKED: usize = FINGERS * (2 * JOINTS + 2);

/// A tick of a recording.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub(crate) inputs: Inputs,
    pub(crate) given: TickInputs,
    /// The requests, each with the number of its finger.
    pub(crate) requests: heapless::Vec<(usize, FingerRequest<JOINTS>), ASKED>,
    pub(crate) done: TickEnd,
}

/// A recording that is read.
pub(crate) struct Rows<R> {
    file: McapReader<R>,
    ticks: u32,
    acceleration: [f64; 3],
}

/// A message: its channel, and what it has, with zeros after it.
struct Message {
    channel: u16,
    len: usize,
    words: [u32; WORDS],
}

/// A message of channel 1.
#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Tick {
    period_s: f64,
    inputs: Inputs,
}

impl<R: Read<Error = FileError>> Rows<R> {
    /// # Errors
    /// Returns the file's error if it cannot be read, or an error if the file is not a recording.
    pub(crate) fn new(file: R) -> Result<(Head, Self), ServoRecordingError> {
        let wrong = |error| ServoRecordingError::of(0, error);
        let mut file = McapReader::new(file).map_err(wrong)?;
        let mut buffer = [0; RECORD];
        let head = loop {
            match file.next(&mut buffer).map_err(wrong)? {
                Some(McapRecord::Header { .. }) => {}
                Some(McapRecord::Metadata { name, pairs }) if name == METADATA => {
                    break Head::read(Some(pairs))?;
                }
                _ => break Head::read(None)?,
            }
        };
        let rows = Self {
            file,
            ticks: 0,
            acceleration: [0.0; 3],
        };
        Ok((head, rows))
    }

    /// Returns the number of ticks until now.
    pub(crate) const fn ticks(&self) -> u32 {
        self.ticks
    }

    /// Returns the next tick; `None` at the end.
    ///
    /// # Errors
    /// Returns the file's error if it cannot be read, or an error if the file is not a recording or only a part
    /// of one.
    pub(crate) fn next(&mut self) -> Result<Option<Row>, ServoRecordingError> {
        let first = self.message()?;
        if first.channel == channel::END {
            let ticks: u32 = self.whole(&first)?;
            return if ticks == self.ticks {
                Ok(None)
            } else {
                Err(self.wrong(&first))
            };
        }
        if first.channel != channel::TICK {
            return Err(self.wrong(&first));
        }
        let Tick { period_s, inputs } = self.whole(&first)?;
        let mut grasp = GraspInputs::default();
        let mut requests = heapless::Vec::new();
        loop {
            let message = self.message()?;
            match message.channel {
                channel::PALM => self.acceleration = self.whole(&message)?,
                channel::ORDER => {
                    let order = message.order();
                    grasp.order = Some(order.ok_or_else(|| self.wrong(&message))?);
                }
                channel::OTHERS => {
                    grasp.others = Some(self.whole::<Joints>(&message)?.of_hand());
                }
                channel::ASKED => {
                    let one = message.request().ok_or_else(|| self.wrong(&message))?;
                    requests.push(one).map_err(|_| self.wrong(&message))?;
                }
                channel::DONE => {
                    let done = self.whole(&message)?;
                    self.ticks = self.ticks.saturating_add(1);
                    let given = TickInputs {
                        period_s,
                        acceleration: self.acceleration,
                        grasp,
                    };
                    return Ok(Some(Row {
                        inputs,
                        given,
                        requests,
                        done,
                    }));
                }
                _ => return Err(self.wrong(&message)),
            }
        }
    }

    fn message(&mut self) -> Result<Message, ServoRecordingError> {
        let ticks = self.ticks;
        let mut buffer = [0; RECORD];
        loop {
            let record = self.file.next(&mut buffer);
            let record = record.map_err(|error| ServoRecordingError::of(ticks, error))?;
            let (message, data) = match record {
                Some(McapRecord::Message(message, data)) => (message, data),
                Some(_) => continue,
                None => return Err(ServoRecordingError::BrokenOff { ticks }),
            };
            let channel = message.channel;
            let message = Message::new(channel, data);
            let bytes = data.len();
            return message.ok_or(ServoRecordingError::Message {
                ticks,
                channel,
                bytes,
            });
        }
    }

    /// A message as a `T`, which it must be as long as.
    fn whole<T: FromBytes>(&self, message: &Message) -> Result<T, ServoRecordingError> {
        let bytes = message.words.as_bytes().get(..message.len);
        T::read_from_bytes(bytes.unwrap_or(&[])).map_err(|_| self.wrong(message))
    }

    const fn wrong(&self, message: &Message) -> ServoRecordingError {
        ServoRecordingError::Message {
            ticks: self.ticks,
            channel: message.channel,
            bytes: message.len,
        }
    }
}

impl Message {
    /// Returns `None` if the data are not CDR, or too long.
    fn new(channel: u16, data: &[u8]) -> Option<Self> {
        let data = data.strip_prefix(&channel::ENCAPSULATION)?;
        let mut words = [0; WORDS];
        let len = data.len();
        words.as_mut_bytes().get_mut(..len)?.copy_from_slice(data);
        Some(Self {
            channel,
            len,
            words,
        })
    }

    /// An order and its number; none if this is not as long.
    fn order(&self) -> Option<(u64, GraspOrder)> {
        let bytes = self.words.as_bytes().get(..self.len)?;
        let (number, order) = u64::read_from_prefix(bytes).ok()?;
        Some((number, GraspOrder::read_from_bytes(order).ok()?))
    }

    fn request(&self) -> Option<(usize, FingerRequest<JOINTS>)> {
        let [finger, count, words @ ..] = &self.words;
        let words = words.get(..usize::try_from(*count).ok()?)?;
        let finger = usize::try_from(*finger).ok().filter(|&it| it < FINGERS)?;
        let is_whole = self.len == size_of_val(words) + 8;
        is_whole.then_some((finger, FingerRequest::take(words)?))
    }
}

impl ServoRecordingError {
    const fn of(ticks: u32, error: McapError<FileError>) -> Self {
        match error {
            McapError::Io(error) => Self::File(error),
            McapError::BrokenOff => Self::BrokenOff { ticks },
            error => Self::Mcap { ticks, error },
        }
    }
}
