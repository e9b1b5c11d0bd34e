//! The processes of a round: pinned, watched, and never left behind.

use std::fs;
use std::io::{BufRead as _, BufReader, PipeReader, Read as _, Write as _, pipe};
use std::os::unix::net::UnixStream;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{self, ChildStdin, ChildStdout, Command, Stdio};
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

/// Runs a server and a client in two child processes, each on its core, and returns the figures of the client.
///
/// # Safety
/// As for [`Child::fork`].
pub(crate) unsafe fn part(
    cores: CorePair,
    limit: Duration,
    server: impl FnOnce(&Orders) -> Result<()>,
    client: impl FnOnce(&Orders) -> Result<Vec<f64>>,
) -> Result<Vec<f64>> {
    let (sent, taken) = UnixStream::pair()?;
    let (sent, taken) = (Orders(sent), Orders(taken));
    // SAFETY: one thread only, by this function's contract.
    let server = unsafe {
        Child::fork("server", limit, || {
            pin(cores.second)?;
            server(&taken)?;
            Ok(Vec::new())
        })
    }?;
    // SAFETY: as above.
    let client = unsafe {
        Child::fork("client", limit, || {
            pin(cores.first)?;
            client(&sent)
        })
    }?;
    let figures = client.figures()?;
    server.figures()?;
    Ok(figures)
}

/// An end of the line by which a client tells its server what to do, and the server how far it is.
pub(crate) struct Orders(UnixStream);

impl Orders {
    /// Sends an order.
    pub(crate) fn send(&self, order: [u32; 3]) -> Result<()> {
        Ok((&self.0).write_all(order.map(u32::to_ne_bytes).as_flattened())?)
    }

    /// Waits for an order.
    pub(crate) fn take(&self) -> Result<[u32; 3]> {
        let mut words = [[0; 4]; 3];
        (&self.0).read_exact(words.as_flattened_mut())?;
        Ok(words.map(u32::from_ne_bytes))
    }

    /// Says that this end has come so far.
    pub(crate) fn say(&self) -> Result<()> {
        Ok((&self.0).write_all(&[0])?)
    }

    /// Waits until the other end says that it has come so far.
    pub(crate) fn hear(&self) -> Result<()> {
        Ok((&self.0).read_exact(&mut [0])?)
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

/// A program that runs, and is interrupted when dropped.
pub(crate) struct Running(process::Child);

impl Running {
    pub(crate) fn of(command: &mut Command) -> Result<Self> {
        Ok(Self(command.spawn()?))
    }

    /// Returns the time on a core that the process has had, in s.
    pub(crate) fn cpu(&self) -> Result<f64> {
        cpu_of(self.0.id().into())
    }

    /// Takes the standard output of the process, which is a pipe.
    pub(crate) fn output(&mut self) -> Result<ChildStdout> {
        Ok(self.0.stdout.take().ok_or("no standard output")?)
    }

    fn interrupt(&self) -> Result<()> {
        let pid = Pid::from_raw(self.0.id().try_into()?).ok_or("no process")?;
        Ok(kill_process(pid, Signal::INT)?)
    }

    /// Ends it as ^C does.
    ///
    /// # Errors
    /// Returns an error if the process does not end well.
    pub(crate) fn end(mut self) -> Result<()> {
        self.interrupt()?;
        let status = self.0.wait()?;
        if status.success() {
            Ok(())
        } else {
            Err(format!("a watcher ends with {status}").into())
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if matches!(self.0.try_wait(), Ok(None)) && self.interrupt().is_ok() {
            // The process has ended, whatever its status is.
            let _ = self.0.wait();
        }
    }
}

/// A program that is asked line by line.
pub(crate) struct Asked {
    pub(crate) running: Running,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Asked {
    pub(crate) fn of(command: &mut Command) -> Result<Self> {
        let mut running = Running::of(command.stdin(Stdio::piped()).stdout(Stdio::piped()))?;
        Ok(Self {
            input: running.0.stdin.take(),
            output: BufReader::new(running.output()?),
            running,
        })
    }

    /// Sends a line.
    pub(crate) fn tell(&mut self, line: &str) -> Result<()> {
        let input = self.input.as_mut().ok_or("no standard input")?;
        Ok(writeln!(input, "{line}")?)
    }

    /// Closes the input of the program.
    pub(crate) fn end_input(&mut self) {
        self.input = None;
    }

    /// Reads a line.
    ///
    /// # Errors
    /// Returns an error if the program has ended.
    pub(crate) fn line(&mut self) -> Result<String> {
        let mut line = String::new();
        if self.output.read_line(&mut line)? == 0 {
            return Err(format!("a program has ended: {:?}", self.running.0.try_wait()?).into());
        }
        Ok(line)
    }
}

/// Returns the time on a core that a process has had, in s.
pub(crate) fn cpu_of(pid: u64) -> Result<f64> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat"))?;
    // The name of the program is in parentheses, and may contain anything.
    let (_, fields) = stat.rsplit_once(')').ok_or("no name in stat")?;
    let times = fields.split_whitespace().skip(11).take(2);
    let ticks: Vec<u64> = times
        .map(str::parse)
        .collect::<std::result::Result<_, _>>()?;
    Ok(ticks.iter().sum::<u64>() as f64 / rustix::param::clock_ticks_per_second() as f64)
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
