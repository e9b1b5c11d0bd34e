//! The processes of a round: pinned, watched, and never left behind.

use std::io::{PipeReader, Read as _, Write as _, pipe};
use std::os::fd::OwnedFd;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::{
    Pid, PidfdFlags, Signal, WaitOptions, getpid, getppid, kill_process, pidfd_open,
    set_parent_process_death_signal, waitpid,
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
    /// The first two cores that this program may run on.
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

/// A child process; killed when dropped, and by the kernel when its parent dies.
pub(crate) struct Child {
    name: &'static str,
    pid: Pid,
    handle: OwnedFd,
    figures: PipeReader,
    ended: bool,
}

impl Child {
    /// Runs `body` in a child process, and keeps the figures that it returns.
    ///
    /// # Safety
    /// The calling process must have one thread only: the others would be missing in the child,
    /// with whatever they had locked.
    pub(crate) unsafe fn fork(
        name: &'static str,
        body: impl FnOnce() -> Result<Vec<f64>>,
    ) -> Result<Self> {
        let parent = getpid();
        let (figures, mut desk) = pipe()?;
        // SAFETY: with one thread, the child is a whole copy of its parent.
        let pid = unsafe { libc::fork() };
        if pid == 0 {
            let result = catch_unwind(AssertUnwindSafe(|| -> Result<()> {
                set_parent_process_death_signal(Some(Signal::KILL))?;
                if getppid() != Some(parent) {
                    return Err("the parent has died".into());
                }
                Ok(desk.write_all(&bytes_of(&body()?))?)
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
        match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(handle) => Ok(Self {
                name,
                pid,
                handle,
                figures,
                ended: false,
            }),
            Err(error) => {
                let _ = kill_process(pid, Signal::KILL);
                let _ = waitpid(Some(pid), WaitOptions::empty());
                Err(error.into())
            }
        }
    }

    /// The figures of a process that has ended well.
    pub(crate) fn figures(&mut self) -> Result<Vec<f64>> {
        let mut bytes = Vec::new();
        self.figures.read_to_end(&mut bytes)?;
        Ok(figures_of(&bytes))
    }

    /// Takes note of the end of a process that has ended.
    fn reap(&mut self) -> Result<()> {
        let Some((_, status)) = waitpid(Some(self.pid), WaitOptions::NOHANG)? else {
            return Ok(());
        };
        self.ended = true;
        match (status.exit_status(), status.terminating_signal()) {
            (Some(0), _) => Ok(()),
            (Some(code), _) => Err(format!("the {} failed with {code}", self.name).into()),
            (_, signal) => Err(format!("the {} was ended by signal {signal:?}", self.name).into()),
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

/// Figures as they go through a pipe.
fn bytes_of(figures: &[f64]) -> Vec<u8> {
    figures
        .iter()
        .flat_map(|figure| figure.to_ne_bytes())
        .collect()
}

/// What [`bytes_of`] was given.
fn figures_of(bytes: &[u8]) -> Vec<f64> {
    let (figures, _) = bytes.as_chunks();
    figures.iter().copied().map(f64::from_ne_bytes).collect()
}

/// Waits until all have ended well.
///
/// # Errors
/// The first that ends otherwise, or `limit` has passed; then drop the rest.
pub(crate) fn wait_for_all(children: &mut [Child], limit: Duration) -> Result<()> {
    let deadline = Instant::now() + limit;
    while children.iter().any(|child| !child.ended) {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(format!("no end after {limit:?}").into());
        }
        let running = children.iter().filter(|child| !child.ended);
        let mut handles: Vec<_> = running
            .map(|child| PollFd::new(&child.handle, PollFlags::IN))
            .collect();
        let timeout = Timespec::try_from(left)?;
        match poll(&mut handles, Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        for child in children.iter_mut().filter(|child| !child.ended) {
            child.reap()?;
        }
    }
    Ok(())
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
