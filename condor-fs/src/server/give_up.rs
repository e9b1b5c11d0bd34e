//! The end of a request at which the server has died twice: see "Deadly requests" in WIRE.md.

use super::error::Stop;
use super::log::{Log, Outcome};
use super::names::remaining;
use super::tree::about;
use super::{FileServer, Job, Steps};
use crate::errno::Errno;
use crate::wire::{FileIdentity, Operation, whole};

impl<S: Steps> FileServer<S> {
    /// Whether a request that `incarnations` have taken is not worked on any more.
    pub(super) const fn is_given_up(&self, incarnations: u32) -> bool {
        incarnations > self.options.incarnations
    }

    /// The result of an operation of which nothing more is done: success if all that clients see of it
    /// has happened.
    pub(super) fn give_up(
        &self,
        job: &Job<'_>,
        log: &Log<'_>,
        incarnations: u32,
    ) -> Result<Outcome, Stop> {
        // To look at what has happened may be what kills the server: one incarnation tries it.
        if let Some(staged) = log.staged()?
            && incarnations == self.options.incarnations.saturating_add(1)
        {
            self.what_happened(job, log, &staged)
        } else {
            Err(Errno::CANCELED.into())
        }
    }

    /// Removes what is left of a request that was given up, and answered.
    pub(super) fn clear_away(&self, job: &Job<'_>) {
        // If the file is not there any more, neither is its mode.
        let _ = self.give_mode_back(job);
        if self.is_set_aside(job) == Ok(false) {
            // Mostly there is nothing.
            let _ = self.discard(&job.unique_name());
        }
    }

    fn what_happened(
        &self,
        job: &Job<'_>,
        log: &Log<'_>,
        staged: &[u32; 8],
    ) -> Result<Outcome, Stop> {
        let evidence = FileIdentity::from_words(staged);
        let place = |span| -> Result<_, Stop> { Ok(self.tree.place(&job.path(span)?)) };
        let first = job.request.path;
        let mut outcome = Outcome::default();
        let happened = match job.operation {
            Operation::MakeDirectory => {
                let found = place(first)?.and_then(|place| Ok(place.about()?));
                found.is_ok_and(|(_, status)| status.is_directory())
            }
            Operation::Open => {
                let found = place(first)?.and_then(|place| Ok(place.about()?)).ok();
                outcome.about = found.filter(|(found, _)| *found == evidence);
                outcome.about.is_some()
            }
            Operation::Unlink | Operation::RemoveDirectory => {
                self.finish_aside(job, log)? || remaining(place(first)?, log)?.is_none()
            }
            Operation::Rename => {
                let (from, to) = (place(first)?, place(job.request.second_path)?);
                let places = from.and_then(|from| Ok((from, to?)));
                self.finish_aside(job, log)? || self.finish_rename(job, &places, evidence)?
            }
            Operation::Append => {
                let file = &self.opened(job)?.file;
                let [begin, begin_high, ..] = *staged;
                let range = whole(begin, begin_high)..about(file, c"")?.1.size;
                outcome.value = job.appended(file, range)?;
                outcome.value > 0
            }
            _ => false,
        };
        if happened {
            Ok(outcome)
        } else {
            Err(Errno::CANCELED.into())
        }
    }
}
