//! [`keep`]: runs a supervisor, and ends every process that would outlive it.
//!
//! The kernel kills programs when their supervisor dies, but not the descendants of programs. The
//! supervisor is made the parent of every descendant that loses its own parent, however it has
//! detached itself; the supervisor kills these when it ends. The keeper is the supervisor's parent.
//! If the supervisor is killed, the keeper inherits the descendants and kills them. If the keeper
//! is killed, the supervisor takes the system down.
//!
//! This needs no control groups, which ordinary users often cannot make. If keeper and supervisor
//! are killed at the same moment, descendants that have made process groups of their own remain;
//! the next supervisor ends the process groups of the programs.

use std::io::Error;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, ExitStatus};

use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitOptions, WaitStatus};
use signal_hook::consts::SIGCHLD;

use super::stat;
use crate::launch::process::die_with_parent;
use crate::signals::EndSignals;

/// Runs the command of a supervisor until it ends, and then kills all descendants of this process. Returns the exit
/// status of the supervisor. A signal that asks this process to end is passed on to the supervisor as SIGTERM.
///
/// Call this only in a process that does nothing else and has one thread: it waits for all its children.
///
/// # Errors
/// Returns the operating system's error if the supervisor cannot be started or waited for.
pub fn keep(mut supervisor: Command) -> Result<ExitStatus, Error> {
    adopt()?;
    let mut told = EndSignals::new()?;
    let mut children = EndSignals::of(&[SIGCHLD])?;
    // ^C is passed on, once; and a session has no terminal that could stop it when it writes there.
    die_with_parent(&mut supervisor, Signal::TERM, true);
    // Only this thread waits for the supervisor, so its number stays its own until then.
    let supervisor = Pid::from_child(&supervisor.spawn()?);
    let status = loop {
        if let Some(status) = reap(supervisor)? {
            break status;
        }
        for _ in 0..told.taken() {
            rustix::process::kill_process(supervisor, Signal::TERM)?;
        }
        let mut polled = [
            PollFd::from_borrowed_fd(told.descriptor(), PollFlags::IN),
            PollFd::from_borrowed_fd(children.descriptor(), PollFlags::IN),
        ];
        match rustix::event::poll(&mut polled, None) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        children.taken();
    };
    end_children()?;
    Ok(ExitStatus::from_raw(status.as_raw()))
}

/// Takes all children that have ended; how the supervisor did, if it is among them.
fn reap(supervisor: Pid) -> Result<Option<WaitStatus>, Errno> {
    loop {
        match rustix::process::wait(WaitOptions::NOHANG) {
            Ok(Some((process, status))) if process == supervisor => return Ok(Some(status)),
            Ok(Some(_)) | Err(Errno::INTR) => {}
            Ok(None) => return Ok(None),
            Err(error) => return Err(error),
        }
    }
}

/// Makes this process the parent of all descendants that lose theirs.
pub(super) fn adopt() -> Result<(), Error> {
    Ok(rustix::process::set_child_subreaper(Some(
        rustix::process::getpid(),
    ))?)
}

/// Takes adopted children that have ended, so that nothing is left of them.
pub(super) fn reap_adopted(is_own: impl Fn(u32) -> bool) {
    for child in stat::children_of_this_thread() {
        if !is_own(child.as_raw_pid().cast_unsigned()) {
            // The child runs on, or it is gone now.
            let _ = rustix::process::waitpid(Some(child), WaitOptions::NOHANG);
        }
    }
}

/// Kills all children, and the descendants that become children because their parents are killed.
pub(super) fn end_children() -> Result<(), Error> {
    loop {
        for child in stat::children(std::process::id())? {
            // The child may have ended.
            let _ = rustix::process::kill_process(child, Signal::KILL);
        }
        match rustix::process::wait(WaitOptions::empty()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(Errno::CHILD) => return Ok(()),
            Err(error) => return Err(error.into()),
        }
    }
}
