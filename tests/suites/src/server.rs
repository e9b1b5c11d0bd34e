//! The file server, in a process of its own that kills itself at random steps and is started again.

use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{Command, ExitStatus};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use condor_fs::server::{FileServer, ServerOptions, Step, Steps};
use condor_fs::wire::Operation;
use condor_mbox::Processor;
use condor_mbox::linux::LinuxSystem;
use rustix::fs::Mode;
use rustix::process::{Pid, Signal};
use rustix::process::{getpid, getppid, kill_process, set_parent_process_death_signal, umask};

use crate::{AnyError, N};

pub(crate) const SERVER: Processor = Processor(0);
/// The first argument of a process that is the server.
const PART: &str = "--server";

/// Kills its own process at the step after which none is left.
struct KillAfter {
    steps: AtomicU64,
}

impl Steps for KillAfter {
    fn reached(&self, _: Operation, _: Step) {
        if self.steps.fetch_sub(1, Ordering::Relaxed) == 1 {
            let _ = kill_process(getpid(), Signal::KILL);
        }
    }
}

/// Is the server if the arguments say so; returns whether they did.
pub(crate) fn served() -> Result<bool, AnyError> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [PART, tree, steps, parent] = &*arguments.iter().map(String::as_str).collect::<Vec<_>>()
    else {
        return Ok(false);
    };
    // The kernel has applied that of who asks.
    umask(Mode::empty());
    set_parent_process_death_signal(Some(Signal::KILL))?;
    if getppid() != Pid::from_raw(parent.parse()?) {
        return Err("the parent has ended".into());
    }
    let steps = KillAfter {
        steps: AtomicU64::new(steps.parse()?),
    };
    let options = ServerOptions {
        // No request is to blame for a kill.
        incarnations: u32::MAX,
        ..ServerOptions::default()
    };
    let server = FileServer::with_steps(tree, options, steps)?;
    let claim = LinuxSystem::<N>::inherited()?.claim(SERVER)?;
    server.serve(claim, &AtomicBool::new(false))?;
    Ok(true)
}

/// Starts a server again whenever one was killed, until this process ends.
pub(crate) struct Supervisor {
    kills: Arc<AtomicU64>,
    thread: JoinHandle<AnyError>,
}

impl Supervisor {
    /// Starts servers. Each of them dies after `steps` steps on average, after a number of steps that
    /// `seed` decides.
    pub(crate) fn start(
        system: &'static LinuxSystem<N>,
        tree: &Path,
        seed: u64,
        steps: u64,
    ) -> Self {
        let kills = Arc::new(AtomicU64::new(0));
        let (tree, counted) = (tree.to_owned(), kills.clone());
        let mut random = seed | 1;
        let thread = std::thread::spawn(move || {
            loop {
                // xorshift64.
                random ^= random << 13;
                random ^= random >> 7;
                random ^= random << 17;
                let left = (random >> 11) % (2 * steps).max(1) + u64::from(steps > 0);
                match serve(system, &tree, left) {
                    Ok(status) if status.signal() == Some(Signal::KILL.as_raw()) => {
                        counted.fetch_add(1, Ordering::Relaxed);
                    }
                    Ok(status) => return format!("the server has ended: {status}").into(),
                    Err(error) => return error,
                }
            }
        });
        Self { kills, thread }
    }

    /// Returns the number of servers that were killed.
    ///
    /// # Errors
    /// Returns an error if a server could not be started, or ended by itself.
    pub(crate) fn kills(self) -> Result<u64, AnyError> {
        if self.thread.is_finished() {
            return Err(self.thread.join().map_err(|_| "the supervisor panicked")?);
        }
        Ok(self.kills.load(Ordering::Relaxed))
    }
}

/// Runs a server until it dies.
fn serve(system: &LinuxSystem<N>, tree: &Path, steps: u64) -> Result<ExitStatus, AnyError> {
    let mut command = Command::new(std::env::current_exe()?);
    command.arg(PART).arg(tree).arg(steps.to_string());
    command.arg(std::process::id().to_string());
    Ok(system.pass_to(&mut command).spawn()?.wait()?)
}
