//! [`Tape`]: the ring of a recording goes into its file.

use condor_dev::stdio::{BufWriter, Buffering};
use condor_fs::File;
use condor_mbox::{AccessError, MemoryWindow, Messenger, Region};
use condor_mcap::{McapWriter, MessageHead};
use embedded_io::Write as _;

use super::record::{Ring, TapeState};
use super::{Head, ServoRecordingError, channel};

/// Bytes that are written to the file at once.
const WRITTEN: usize = 4096;
/// Bytes that are taken out of the ring at once.
const PIECE: usize = 512;

/// The file of a recording, in the background of a servo processor.
pub(crate) struct Tape<'f, 'm, 'r, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    file: McapWriter<BufWriter<File<'f, 'm, S, W, FILES>, WRITTEN>>,
    rate_hz: u32,
    /// The number of the tick whose messages come next.
    tick: u32,
    region: Region<W>,
    /// The place where the ring begins.
    offset: u32,
    ring: &'r Ring,
}

impl<'f, 'm, 'r, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize>
    Tape<'f, 'm, 'r, S, W, FILES>
{
    pub(crate) fn new(
        file: File<'f, 'm, S, W, FILES>,
        head: Head,
        region: Region<W>,
        offset: u32,
        ring: &'r Ring,
    ) -> Result<Self, ServoRecordingError> {
        Ok(Self {
            file: head.write(BufWriter::new(file, Buffering::Block))?,
            rate_hz: head.rate_hz,
            tick: 0,
            region,
            offset,
            ring,
        })
    }

    /// Writes the ticks that the loop has recorded since the last time; returns the state of the recording.
    ///
    /// # Errors
    /// Returns an error if the recording cannot go on.
    pub(crate) fn wind(&mut self) -> Result<TapeState, ServoRecordingError> {
        // Before the bytes: once it is complete there come no more.
        let state = self.ring.state();
        let outcome = self.empty();
        if outcome.is_err() {
            self.ring.set_state(TapeState::Lost);
        }
        outcome.map(|()| state)
    }

    /// Ends the file after what was recorded; returns how many ticks that is. The loop records no
    /// more.
    ///
    /// # Errors
    /// The recording is not whole: [`ServoRecordingError::Behind`] if the loop was faster.
    pub(crate) fn finish(mut self) -> Result<u32, ServoRecordingError> {
        self.empty()?;
        let (ticks, is_lost) = (self.ring.ticks(), self.ring.state() == TapeState::Lost);
        if !is_lost {
            self.begin(channel::END, size_of_val(&ticks))?;
            self.file.records(&ticks.to_le_bytes())?;
        }
        let mut file = self.file.end()?;
        file.flush()?;
        file.into_inner().close()?;
        if is_lost {
            return Err(ServoRecordingError::Behind { ticks });
        }
        Ok(ticks)
    }

    /// Writes the messages that are in the ring now.
    fn empty(&mut self) -> Result<(), ServoRecordingError> {
        let (mut at, mut filled) = self.ring.filled();
        while filled > 0 {
            let mut head = [0; 4];
            self.read(at, &mut head)?;
            let [low, high, words @ ..] = head;
            let (channel, words) = (u16::from_le_bytes([low, high]), u16::from_le_bytes(words));
            let bytes = 4 + 4 * u32::from(words);
            // Others can write into the ring, too.
            filled = filled
                .checked_sub(bytes)
                .ok_or(ServoRecordingError::Message {
                    ticks: self.tick,
                    channel,
                    bytes: bytes as usize,
                })?;
            let mut left = 4 * usize::from(words);
            self.begin(channel, left)?;
            at = at.wrapping_add(4);
            let mut piece = [0; PIECE];
            while left > 0 {
                let len = left.min(PIECE);
                let piece = piece.get_mut(..len).unwrap_or_default();
                self.read(at, piece)?;
                self.file.records(piece)?;
                at = at.wrapping_add(len as u32);
                left -= len;
            }
            self.ring.take(bytes);
            if channel == channel::DONE {
                self.tick = self.tick.wrapping_add(1);
            }
        }
        Ok(())
    }

    /// Writes what comes before the fields of a message, which have `bytes` bytes.
    fn begin(&mut self, channel: u16, bytes: usize) -> Result<(), ServoRecordingError> {
        let message = MessageHead {
            channel,
            sequence: self.tick,
            log_time_ns: u64::from(self.tick) * 1_000_000_000 / u64::from(self.rate_hz.max(1)),
        };
        let head = message.head(channel::ENCAPSULATION.len() + bytes);
        self.file.records(&head)?;
        Ok(self.file.records(&channel::ENCAPSULATION)?)
    }

    /// Reads from the ring, whose bytes are counted from its first one on.
    fn read(&self, at: u32, into: &mut [u8]) -> Result<(), AccessError> {
        let at = at % Ring::BYTES;
        let middle = into.len().min((Ring::BYTES - at) as usize);
        let (before, after) = into.split_at_mut(middle);
        self.region.read(self.offset.wrapping_add(at), before)?;
        self.region.read(self.offset, after)
    }
}
