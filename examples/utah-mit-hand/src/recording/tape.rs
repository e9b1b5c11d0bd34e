//! [`Tape`]: the ring of a recording goes into its file.

use condor_fs::FileWriter;
use condor_mbox::{MemoryWindow, Messenger, Region};
use embedded_io::Write;
use zerocopy::IntoBytes;

use super::record::{Ring, TapeState};
use super::{Head, RecordingError, kind};

/// Bytes that are taken out of the ring at once.
const PIECE: usize = 512;

/// The file of a recording, in the background of a servo processor.
pub(crate) struct Tape<'f, 'm, 'r, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    file: FileWriter<'f, 'm, S, W, FILES>,
    region: Region<W>,
    /// Where the ring begins.
    offset: u32,
    ring: &'r Ring,
}

impl<'f, 'm, 'r, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize>
    Tape<'f, 'm, 'r, S, W, FILES>
{
    pub(crate) fn new(
        mut file: FileWriter<'f, 'm, S, W, FILES>,
        head: Head,
        region: Region<W>,
        offset: u32,
        ring: &'r Ring,
    ) -> Result<Self, RecordingError> {
        file.write_all(head.as_bytes())?;
        Ok(Self {
            file,
            region,
            offset,
            ring,
        })
    }

    /// Writes what the loop has recorded since the last time; whether that was all.
    ///
    /// # Errors
    /// The recording cannot go on.
    pub(crate) fn wind(&mut self) -> Result<bool, RecordingError> {
        // Before the bytes: once it is complete there come no more.
        let state = self.ring.state();
        let outcome = self.empty();
        if outcome.is_err() {
            self.ring.set_state(TapeState::Lost);
        }
        outcome?;
        match state {
            TapeState::Running => Ok(false),
            TapeState::Complete => Ok(true),
            TapeState::Lost => {
                // What there is of it can still be looked at.
                self.file.flush()?;
                Err(RecordingError::Behind {
                    ticks: self.ring.ticks(),
                })
            }
        }
    }

    /// Ends the recording after what was recorded; gives how many ticks that is. The loop records no
    /// more.
    ///
    /// # Errors
    /// The recording is not whole.
    pub(crate) fn finish(mut self) -> Result<u32, RecordingError> {
        self.empty()?;
        let ticks = self.ring.ticks();
        let end = [kind::END | 1 << 8, ticks];
        self.file.write_all(end.as_bytes())?;
        self.file.close().map_err(|unwritten| unwritten.error)?;
        Ok(ticks)
    }

    fn empty(&mut self) -> Result<(), RecordingError> {
        let mut piece = [0; PIECE];
        loop {
            let (at, filled) = self.ring.filled();
            let len = filled.min(PIECE as u32);
            if len == 0 {
                return Ok(());
            }
            let piece = piece.split_at_mut(len as usize).0;
            self.region.read(self.offset.wrapping_add(at), piece)?;
            self.file.write_all(piece)?;
            self.ring.take(len);
        }
    }
}
