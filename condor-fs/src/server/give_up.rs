//! The end of a request at which the server has died twice: see "Deadly requests" in WIRE.md.

use super::error::Stop;
use super::log::{Log, Outcome, Staged};
use super::names::{GIVEN_BACK, TAKEN};
use super::tree::about;
use super::{Job, Server, Steps};
use crate::errno::Errno;
use crate::wire::{Evidence, Operation, whole};

impl<S: Steps> Server<S> {
    /// Whether a request that `lives` have taken is not worked on any more.
    pub(super) const fn is_given_up(&self, lives: u32) -> bool {
        lives > self.options.lives
    }

    /// The result of an operation of which nothing more is done: success if all that clients see of it
    /// has happened.
    pub(super) fn give_up(
        &self,
        job: &Job<'_>,
        log: &Log<'_>,
        lives: u32,
    ) -> Result<Outcome, Stop> {
        // To look at what has happened may be what kills the server: one life tries it.
        if let Some(staged) = log.staged()?
            && lives == self.options.lives.saturating_add(1)
        {
            self.what_happened(job, &staged)
        } else {
            Err(Errno::CANCELED.into())
        }
    }

    /// Removes what is left of a request that was given up, and answered.
    pub(super) fn clear_away(&self, job: &Job<'_>) {
        if self.is_set_aside(job) == Ok(false) {
            self.tree.discard(&job.unique_name());
        }
    }

    fn what_happened(&self, job: &Job<'_>, staged: &Staged) -> Result<Outcome, Stop> {
        let unique = job.unique_name();
        let evidence = Evidence::from_words(&staged.evidence);
        let mut outcome = Outcome::default();
        let happened = match job.operation {
            Operation::MakeDirectory => self.tree.staged(&unique)?.is_none(),
            Operation::Open => {
                let place = self.tree.place(&job.path(job.request.path)?)?;
                let found = about(&place.parent, &place.name).ok();
                outcome.about = found.filter(|(found, _)| *found == evidence);
                outcome.about.is_some()
            }
            Operation::Unlink | Operation::RemoveDirectory => match self.tree.staged(&unique)? {
                Some((evidence, status)) if !status.is_directory() => {
                    self.mark_silly(job, evidence)?;
                    true
                }
                // Somebody may have put something into it.
                Some(_) => {
                    let place = self.tree.place(&job.path(job.request.path)?)?;
                    self.tree.put(&unique, &place)?;
                    false
                }
                None => staged.step == TAKEN,
            },
            Operation::Rename => {
                let place = self.tree.place(&job.path(job.request.path)?);
                let found = place.and_then(|from| Ok(about(&from.parent, &from.name)?));
                !found.is_ok_and(|(found, _)| found == evidence)
            }
            Operation::Append => {
                let [begin, begin_high, ..] = staged.evidence;
                let size = about(&self.opened(job)?.file, c"")?.1.size;
                let written = size.saturating_sub(whole(begin, begin_high));
                outcome.value = written.min(job.request.buffer.len.into());
                outcome.value > 0
            }
            _ => false,
        };
        if happened {
            Ok(outcome)
        } else if staged.step == GIVEN_BACK {
            Err(Errno::NOTEMPTY.into())
        } else {
            Err(Errno::CANCELED.into())
        }
    }
}
