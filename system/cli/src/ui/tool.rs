//! Programs that are started on a processor, each on a pseudo-terminal of its own.

use std::fs::File;
use std::io;
use std::process::{Command, Stdio};
use std::sync::mpsc::Sender;
use std::thread;

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use super::feed::{UiEvent, pass_on};
use super::window::WindowId;
use condor_host::control::Member;

/// The text that stands for the number of a process.
const PID: &str = "{pid}";

/// A program, such as a debugger, that a person can start from the user interface for the program of a processor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Tool {
    /// The name of the tool, under which the user interface shows it.
    pub(crate) name: String,
    /// A shell command, in which `{pid}` stands for the process id of the processor's program, `{number}`
    /// for the number of the processor, `{system}` for the name of the system, and `{condor}` for this
    /// program.
    pub(crate) command: String,
}

impl std::str::FromStr for Tool {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=');
        let parts = parts.filter(|(name, command)| !name.is_empty() && !command.is_empty());
        let (name, command) = parts.ok_or_else(|| {
            format!("a tool is NAME=COMMAND, such as `gdb=gdb -p {{pid}}`, and not `{text}`")
        })?;
        Ok(Self {
            name: name.into(),
            command: command.into(),
        })
    }
}

impl Tool {
    /// Returns the tool `debugger`, which starts GDB on the program of a processor.
    #[must_use]
    pub(crate) fn debugger() -> Self {
        Self {
            name: "debugger".into(),
            command: "{condor} gdb {number} --system {system}".into(),
        }
    }

    /// The command for a processor, where `condor` is this program; `None` if it needs a process, and
    /// there is none.
    pub(super) fn filled(&self, condor: &str, system: &str, member: &Member) -> Option<String> {
        let command = self.command.replace("{condor}", condor);
        let command = command
            .replace("{number}", &member.number.to_string())
            .replace("{system}", system);
        if !command.contains(PID) {
            return Some(command);
        }
        Some(command.replace(PID, &member.pid?.to_string()))
    }
}

/// The word of the shell that is this program.
pub(super) fn condor() -> io::Result<String> {
    let path = std::env::current_exe()?;
    Ok(format!(
        "'{}'",
        path.to_string_lossy().replace('\'', "'\\''")
    ))
}

/// Starts a command of the shell for the window `id`.
pub(super) fn start(command: &str, id: WindowId, news: &Sender<UiEvent>) -> io::Result<()> {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let host = openpt(flags)?;
    grantpt(&host)?;
    unlockpt(&host)?;
    let path = ptsname(&host, Vec::new())?;
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let user = File::from(rustix::fs::open(&path, flags, Mode::empty())?);
    // The terminal is the command's own, so that Ctrl-C reaches it and nobody else.
    let mut child = Command::new("setsid")
        .args(["--ctty", "--wait", "sh", "-c"])
        .arg(command)
        .env("TERM", "xterm-256color")
        .stdin(Stdio::from(user.try_clone()?))
        .stdout(Stdio::from(user.try_clone()?))
        .stderr(Stdio::from(user))
        .spawn()?;
    let reader = File::from(host.try_clone()?);
    let (heard, news) = (news.send(UiEvent::Opened(id, host.into())), news.clone());
    thread::spawn(move || {
        if heard.is_ok() {
            pass_on(reader, id, &news);
        }
        // The tool ends with its terminal; nobody asks how.
        let _ = child.wait();
    });
    Ok(())
}
