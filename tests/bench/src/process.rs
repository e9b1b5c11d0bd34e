//! The processes of a round: pinned, watched, and never left behind.

use std::io::{PipeReader, Read as _, Write as _, pipe};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use rustix::process::{
    Pid, Signal, WaitOptions, getpid, getppid, kill_process, set_parent_process_death_signal,
    waitpid,
};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use crate::Result;

/// The two cores of a round.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CorePair {
    /// The client's, and the server's if both share one.
    pub(crate) first: usize,
    /// The server's otherwise.
    pub(crate) second: usize,
}

impl CorePair {
    /// Finds the first two cores that this program may run on.
    pub(crate) fn find() -> Result<Self> {
        let allowed = sched_getaffinity(None)?;
        let mut cores = (0..CpuSet::MAX_CPU).filter(|core| allowed.is_set(*core));
        match (cores.next(), cores.next()) {
            (Some(first), Some(second)) => Ok(Self { first, second }),
            _ => Err("two cores are needed".into()),
        }
    }
}

/// Binds the calling thread to a core.
pub(crate) fn pin(core: usize) -> Result<()> {
    let mut set = CpuSet::new();
    set.set(core);
    Ok(sched_setaffinity(None, &set)?)
}

/// A child process; killed when dropped, and by the kernel when its parent dies or its time is up.
pub(crate) struct Child {
    name: &'static str,
    pid: Pid,
    figures: PipeReader,
    ended: bool,
}

impl Child {
    /// Runs `body` in a child process, and keeps the figures that it returns. What takes longer than
    /// `limit` has gone wrong.
    ///
    /// # Safety
    /// The calling process must have one thread only: the others would be missing in the child,
    /// with whatever they had locked.
    pub(crate) unsafe fn fork(
        name: &'static str,
        limit: Duration,
        body: impl FnOnce() -> Result<Vec<f64>>,
    ) -> Result<Self> {
        let parent = getpid();
        let (figures, mut writer) = pipe()?;
        // SAFETY: with one thread, the child is a whole copy of its parent.
        let pid = unsafe { libc::fork() };
        if pid == 0 {
            let result = catch_unwind(AssertUnwindSafe(|| -> Result<()> {
                set_parent_process_death_signal(Some(Signal::KILL))?;
                if getppid() != Some(parent) {
                    return Err("the parent has died".into());
                }
                // SAFETY: nobody handles the signal, which ends the process.
                unsafe { libc::alarm(u32::try_from(limit.as_secs())? + 1) };
                Ok(writer.write_all(&bytes_of(&body()?))?)
            }));
            let code = match result {
                Ok(Ok(())) => 0,
                Ok(Err(error)) => {
                    eprintln!("{name}: {error}");
                    1
                }
                Err(_) => 101,
            };
            // SAFETY: ends the process at once; what the parent had buffered is the parent's.
            unsafe { libc::_exit(code) }
        }
        let pid = Pid::from_raw(pid)
            .filter(|_| pid > 0)
            .ok_or_else(std::io::Error::last_os_error)?;
        Ok(Self {
            name,
            pid,
            figures,
            ended: false,
        })
    }

    /// Waits until the process has ended, and returns its figures.
    ///
    /// # Errors
    /// Returns an error if the process has not ended well, or not in time.
    pub(crate) fn figures(mut self) -> Result<Vec<f64>> {
        let mut bytes = Vec::new();
        self.figures.read_to_end(&mut bytes)?;
        let status = waitpid(Some(self.pid), WaitOptions::empty())?;
        self.ended = true;
        let name = self.name;
        let (_, status) = status.ok_or("no child")?;
        match (status.exit_status(), status.terminating_signal()) {
            (Some(0), _) => Ok(figures_of(&bytes)),
            (Some(code), _) => Err(format!("the {name} failed with {code}").into()),
            (_, signal) => Err(format!("the {name} was ended by signal {signal:?}").into()),
        }
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        if !self.ended {
            // Nothing can be done about a failure of either: the process is not there any more.
            let _ = kill_process(self.pid, Signal::KILL);
            let _ = waitpid(Some(self.pid), WaitOptions::empty());
        }
    }
}

/// Converts figures to the bytes that go through a pipe.
fn bytes_of(figures: &[f64]) -> Vec<u8> {
    figures
        .iter()
        .flat_map(|figure| figure.to_ne_bytes())
        .collect()
}

/// Returns the figures from which [`bytes_of`] made these bytes.
fn figures_of(bytes: &[u8]) -> Vec<f64> {
    let (figures, _) = bytes.as_chunks();
    figures.iter().copied().map(f64::from_ne_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_survive_the_pipe() {
        let figures = [1.0, -2.5, 0.0];
        assert!(figures_of(&bytes_of(&figures)).iter().eq(&figures));
    }
}
