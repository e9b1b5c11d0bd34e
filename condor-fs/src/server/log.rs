//! [`Log`]: the server's part of a slot.

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{MemoryWindow, Region};

use super::Job;
use super::error::Stop;
use crate::errno::Errno;
use crate::wire::{self, FileIdentity, FileStatus, Space, slot, state};

/// The outcome of an operation.
#[derive(Clone, Copy, Default)]
pub(super) struct Outcome {
    pub(super) value: u64,
    pub(super) about: Option<(FileIdentity, FileStatus)>,
    pub(super) space: Option<Space>,
}

impl Outcome {
    pub(super) fn of(about: (FileIdentity, FileStatus)) -> Self {
        Self {
            about: Some(about),
            ..Self::default()
        }
    }
}

/// The record of one operation.
pub(super) struct Log<'l> {
    region: Region<&'l LinuxWindow>,
    at: u32,
    session: u64,
    sequence: u64,
}

impl<'l> Log<'l> {
    pub(super) fn of(job: &Job<'l>) -> Self {
        Self {
            region: job.region,
            at: job.slot,
            session: job.request.session,
            sequence: job.request.sequence,
        }
    }

    /// Notes that this incarnation of the server works on the operation; returns the number of incarnations
    /// that now have, or `None` if the operation is done.
    pub(super) fn take(&self) -> Result<Option<u32>, Stop> {
        match self.state()? {
            state::DONE => Ok(None),
            state::NONE => {
                for (offset, word) in self.words_of_first() {
                    self.set(offset, &[word])?;
                }
                Ok(Some(1))
            }
            _ => {
                let incarnations = self
                    .region
                    .word(self.at + slot::INCARNATIONS)?
                    .saturating_add(1);
                self.set(slot::INCARNATIONS, &[incarnations])?;
                Ok(Some(incarnations))
            }
        }
    }

    /// Returns the words that the first incarnation that takes the operation writes, in this order. The
    /// words of a former operation are still there: the state is changed before the words that say whose it
    /// is.
    fn words_of_first(&self) -> [(u32, u32); 6] {
        let ([session, session_high], [sequence, sequence_high]) =
            (wire::halves(self.session), wire::halves(self.sequence));
        [
            (slot::STATE, state::TAKEN),
            (slot::INCARNATIONS, 1),
            (slot::STATE_SESSION, session),
            (slot::STATE_SESSION + 4, session_high),
            (slot::STATE_SEQUENCE, sequence),
            (slot::STATE_SEQUENCE + 4, sequence_high),
        ]
    }

    /// Takes back the last [`take`](Self::take): nothing was done.
    pub(super) fn give_back(&self, incarnations: u32) -> Result<(), Stop> {
        self.set(slot::INCARNATIONS, &[incarnations.saturating_sub(1)])
    }

    /// Returns the recorded words, if the operation was staged.
    pub(super) fn staged(&self) -> Result<Option<[u32; 8]>, Stop> {
        if self.state()? != state::STAGED {
            return Ok(None);
        }
        Ok(Some(words(&self.region, self.at + slot::EVIDENCE)?))
    }

    /// Records the intent, with what a next incarnation must know.
    pub(super) fn stage(&self, evidence: &[u32]) -> Result<(), Stop> {
        self.set(slot::EVIDENCE, evidence)?;
        self.set(slot::STATE, &[state::STAGED])
    }

    pub(super) fn record(&self, outcome: &Result<Outcome, Errno>) -> Result<(), Stop> {
        let (errno, outcome) = match outcome {
            Ok(outcome) => (0, *outcome),
            Err(errno) => (u32::from(errno.0), Outcome::default()),
        };
        self.set(slot::ERRNO, &[errno])?;
        self.set(slot::VALUE, &wire::halves(outcome.value))?;
        if let Some((evidence, status)) = outcome.about {
            self.set(slot::EVIDENCE, &evidence.to_words())?;
            self.set(slot::STATUS, &status.to_words())?;
        }
        if let Some(space) = outcome.space {
            self.set(slot::STATUS, &space.to_words())?;
        }
        self.set(slot::STATE, &[state::DONE])
    }

    /// The state, if it is that of this operation.
    fn state(&self) -> Result<u32, Stop> {
        let state = self.region.word(self.at + slot::STATE)?;
        let [session, session_high, sequence, sequence_high] =
            words(&self.region, self.at + slot::STATE_SESSION)?;
        let of_this = wire::whole(session, session_high) == self.session
            && wire::whole(sequence, sequence_high) == self.sequence;
        Ok(if of_this { state } else { state::NONE })
    }

    /// In order: the next server sees no word without those before it.
    fn set(&self, offset: u32, words: &[u32]) -> Result<(), Stop> {
        for (word, at) in words.iter().zip((self.at + offset..).step_by(4)) {
            self.region.set_word(at, *word)?;
        }
        Ok(())
    }
}

/// Words of the client's window, each read once.
pub(super) fn words<const K: usize>(
    region: &Region<&LinuxWindow>,
    offset: u32,
) -> Result<[u32; K], Errno> {
    region.check(offset, 4 * K).map_err(|_| Errno::FAULT)?;
    let mut words = [0; K];
    for (word, at) in words.iter_mut().zip((offset..).step_by(4)) {
        *word = region.word(at).map_err(|_| Errno::FAULT)?;
    }
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use condor_mbox::layout::BELL_BYTES;
    use condor_mbox::linux::WindowAccess;

    #[test]
    fn no_state_of_a_former_operation_is_taken_for_that_of_the_next() {
        const BYTES: u32 = BELL_BYTES + slot::BYTES;
        let file = tempfile::tempfile().unwrap();
        file.set_len(BYTES.into()).unwrap();
        let window = LinuxWindow::map(&file, 0, BYTES, WindowAccess::ReadWrite).unwrap();
        let log = |session, sequence| Log {
            region: Region::users(&window).unwrap(),
            at: 0,
            session,
            sequence,
        };
        let both = |low| wire::whole(low, low);
        for (session, sequence) in [(both(7), both(4)), (both(8), both(3)), (both(8), both(4))] {
            let (former, next) = (log(both(7), both(3)), log(session, sequence));
            let words = next.words_of_first();
            for written in 0..=words.len() {
                window.write(0, &[0; BYTES as usize]).unwrap();
                former.take().unwrap();
                former.record(&Ok(Outcome::default())).unwrap();
                assert!(former.take().unwrap().is_none());
                // The server is killed in between.
                for (offset, word) in &words[..written] {
                    next.set(*offset, &[*word]).unwrap();
                }
                let incarnations = next.take().unwrap();
                assert!(incarnations.is_some(), "it is done after {written} words");
                assert!(incarnations == Some(2) || written < words.len());
            }
        }
    }
}
