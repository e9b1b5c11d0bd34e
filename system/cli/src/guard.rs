//! [`Guard`]: restores the terminal if the user interface is killed.
//!
//! A process that is killed by SIGKILL cannot clean up. So a shell waits at the end of a pipe: if
//! the pipe closes before a word has come, the shell restores the settings of the terminal.

use std::ffi::OsStr;
use std::io::{self, Read, Write};
use std::process::{Child, ChildStdin, Command, Stdio};

/// Its arguments are the terminal, and what leaves the screen of the user interface. A terminal that
/// is not its own any more would stop it, and keys that end programs are not meant for it.
const SCRIPT: &str = r#"
trap '' HUP INT QUIT TERM TTIN TTOU
saved=$(stty -g <"$0") || exit
echo ready
read -r word || { stty "$saved" <"$0"; printf %s "$1" >"$0"; }
"#;

/// A shell that waits.
#[derive(Debug)]
pub(crate) struct Guard {
    shell: Child,
    word: ChildStdin,
}

impl Guard {
    /// Waits until the shell knows how the terminal is; `leave` is what it writes at the end.
    pub(crate) fn start(terminal: &OsStr, leave: &str) -> io::Result<Self> {
        let mut shell = Command::new("sh")
            .args(["-c", SCRIPT])
            .arg(terminal)
            .arg(leave)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let (word, ready) = (shell.stdin.take(), shell.stdout.take());
        let count = match ready {
            Some(mut ready) => ready.read(&mut [0; 16])?,
            None => 0,
        };
        match word {
            Some(word) if count > 0 => Ok(Self { shell, word }),
            _ => {
                shell.wait()?;
                Err(io::Error::other(
                    "cannot start the shell that restores the terminal",
                ))
            }
        }
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        // If it has gone, nobody restores anything.
        let _ = self.word.write_all(b"left\n");
        let _ = self.shell.wait();
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::os::unix::ffi::OsStrExt;

    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{LocalModes, OptionalActions, tcgetattr, tcsetattr};

    use super::*;

    #[test]
    fn the_terminal_is_restored_for_who_is_killed_and_left_alone_for_who_leaves() {
        let host = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&host).unwrap();
        unlockpt(&host).unwrap();
        let path = ptsname(&host, Vec::new()).unwrap();
        let path = OsStr::from_bytes(path.as_bytes());
        let terminal = File::options().read(true).write(true).open(path).unwrap();
        let echoes = || {
            let modes = tcgetattr(&terminal).unwrap().local_modes;
            modes.contains(LocalModes::ECHO)
        };
        for is_killed in [true, false] {
            let before = tcgetattr(&terminal).unwrap();
            assert!(echoes());
            let mut guard = Guard::start(path, "bye").unwrap();
            let mut raw = before.clone();
            raw.make_raw();
            tcsetattr(&terminal, OptionalActions::Now, &raw).unwrap();
            assert!(!echoes());
            if is_killed {
                // As the kernel does.
                let null = Command::new("true").stdin(Stdio::piped()).spawn();
                let mut null = null.unwrap();
                guard.word = null.stdin.take().unwrap();
                guard.shell.wait().unwrap();
                null.wait().unwrap();
                let mut shown = [0; 3];
                File::from(host.try_clone().unwrap())
                    .read_exact(&mut shown)
                    .unwrap();
                assert_eq!(&shown, b"bye");
            }
            drop(guard);
            assert_eq!(echoes(), is_killed);
            tcsetattr(&terminal, OptionalActions::Now, &before).unwrap();
        }
    }

    #[test]
    fn what_is_no_terminal_has_no_guard() {
        assert!(Guard::start(OsStr::new("/dev/null"), "bye").is_err());
    }
}
