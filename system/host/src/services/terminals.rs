//! The terminals of all processors: in a log, on a pseudo-terminal, and on a socket.
//!
//! The directory `tty` of the running system has these files for each processor:
//!
//! | file | purpose |
//! |---|---|
//! | `NAME.log` | holds everything that the terminal has written; lines in brackets mark where a program began and where output was overwritten |
//! | `NAME.old.log` | holds the previous log, from before the last rotation |
//! | `NAME.sock` | a socket: a client gets the end of the log and then new output; bytes that it writes are typed |
//! | `NAME` | a link to a pseudo-terminal, which gets new output; bytes that are written to it are typed |
//! | `NAME.typed` | holds the typed characters; bytes that are appended to it are typed, see [`type_in`]; characters that the program has taken become a hole |
//! | `NAME.mark`, `NAME.typed.mark` | say which byte of the output, and of the input, is at which place in the file |
//!
//! The terminal of a processor is the object `console` in its [object table](condor_rt::objects),
//! or else the first terminal there.
//!
//! If the service is killed, the log neither loses nor repeats a byte: the position in the output
//! follows from the length of the log. The same holds for `NAME.typed`: the terminal keeps in its
//! own memory how many characters the program has taken. Bytes that are still in a socket or a
//! pseudo-terminal when the service is killed are lost. Sockets and pseudo-terminals read the log,
//! each as fast as the program at its other end, so none of them holds up the terminal.
//!
//! At most 64 KiB of typed characters wait for a program. While it does not read them, the service reads
//! no more from sockets and pseudo-terminals, and `condor tty` nothing more from its input: their
//! writers wait, and no character is lost.
//!
//! In simulated time a character is sent when no processor has anything left to do at an instant, one
//! character at a time over all terminals. A [`Script`] of what was sent, and when, is in the file
//! `typing` beside the directory `tty`. Each character is recorded before it is sent, and no time
//! passes until a service that was killed in between is there again and has sent it.

mod mark;
mod record;
mod script;
mod station;
mod typing;
mod viewer;

use std::io::{self, Write as _};
use std::mem::MaybeUninit;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use condor_clock::NEVER;
use condor_mbox::{Doorbell as _, Messenger, Processor, Region};
use condor_platform::linux::WholeFile;
use condor_tty::TerminalVectors;
use rustix::event::{PollFd, PollFlags, Timespec, epoll};
use rustix::fs::inotify;
use rustix::io::Errno;

use super::{ServiceError, claim};
use crate::description::{SystemDescription, TerminalSizes};
use crate::error::NamedFileError;
use crate::signals::EndSignals;
use crate::system::SystemDirectory;
use condor_rt::linux::{HostBell, HostClock};
use condor_rt::numbers::TERMINALS;
pub use script::{Script, ScriptError};
use script::{ScriptWriter, Turn};
use serde::{Deserialize, Serialize};
use station::Station;
pub use typing::Keyboard;

/// The number of turns of simulated time that a service has to find the traces of a previous one: processors
/// answer in between, and no time passes.
const FIRST_TURNS: u32 = 8;

/// The number of times that an ending service looks for the earlier output of programs: a program that goes on
/// writing does not keep it.
const LAST_LOOKS: u32 = 256;

/// The longest wait for events: the service's own heartbeat must go on.
const BEAT: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 500_000_000,
};

/// The settings that the supervisor passes to the service.
#[derive(Serialize, Deserialize)]
pub(crate) struct Settings {
    /// The directory with the sockets and logs of the terminals.
    directory: PathBuf,
    /// The processors that have terminals, each with its name.
    processors: Vec<(u8, String)>,
    sizes: TerminalSizes,
}

impl Settings {
    /// Those of a system.
    pub(crate) fn of(description: &SystemDescription, directory: &SystemDirectory) -> Self {
        let processors = description.processors.iter();
        Self {
            directory: directory.terminals(),
            processors: processors.map(|it| (it.number, it.name.clone())).collect(),
            sizes: description.terminals,
        }
    }
}

/// Serves terminals until SIGTERM.
///
/// # Errors
/// [`ServiceError`] if the terminals cannot be served, or the service was not started by a
/// supervisor.
pub(super) fn serve(settings: &Settings) -> Result<(), ServiceError> {
    let directory = settings.directory.as_path();
    let events = |error: Errno| ServiceError::Events(error.into());
    let mut signals = EndSignals::new().map_err(ServiceError::Events)?;
    let (claim, page) = claim(TERMINALS)?;
    let system = SystemDirectory::at(directory.parent().unwrap_or(directory).into());
    let writer = page.as_ref().map(|_| ScriptWriter::open(&system));
    let writer = writer.transpose()?.map(Rc::new);
    // Pseudo-terminals that nobody has open would end every wait for their level.
    let ptys = epoll::create(epoll::CreateFlags::CLOEXEC).map_err(events)?;
    // And for those of files to which somebody types.
    let flags = inotify::CreateFlags::CLOEXEC | inotify::CreateFlags::NONBLOCK;
    let keyboards = inotify::init(flags).map_err(events)?;
    let mut stations = Vec::new();
    for (number, name) in &settings.processors {
        let number = Processor(*number);
        let Some(window) = claim.windows().get(number.index()) else {
            continue;
        };
        let region = Region::users(window.data.clone()).map_err(|error| {
            condor_mbox::MailboxError::Window {
                processor: number,
                object: condor_mbox::error::MemoryObject::Data,
                kind: error.kind,
            }
        })?;
        let sizes = settings.sizes;
        let station = Station::open(directory, name, number, region, sizes, writer.clone())?;
        let flags = epoll::EventFlags::IN | epoll::EventFlags::OUT | epoll::EventFlags::ET;
        let data = epoll::EventData::new_u64(0);
        epoll::add(&ptys, station.pty(), data, flags).map_err(events)?;
        let file = typing::file_of(&log(directory, name));
        inotify::add_watch(&keyboards, &file, inotify::WatchFlags::MODIFY).map_err(events)?;
        stations.push(station);
    }
    let doorbell = HostBell::of_service(claim.doorbell().clone(), page);
    let bell = doorbell.doorbell().pollable();
    let own = doorbell.clone();
    let mut mailbox = HostBell::mailbox(claim, |_| own)?;
    mailbox.set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "terminal output")?;
    mailbox.join()?;
    mailbox.ring_always(true)?;
    let mut first_turns = FIRST_TURNS;
    let mut last_looks = None;
    loop {
        if signals.taken() > 0 {
            last_looks = last_looks.or(Some(LAST_LOOKS));
        }
        let seen = doorbell.prepare();
        bell.drain();
        mailbox.serve(Duration::ZERO)?;
        let clock = doorbell.clock().zip(writer.as_deref());
        let mut turn = match clock {
            Some((clock, _)) if !clock.has_turn() => Turn::None,
            Some(_) if first_turns > 0 => Turn::Recorded,
            _ => Turn::Any,
        };
        let has_turn = turn != Turn::None;
        let (mut more, mut held) = (false, false);
        for station in &mut stations {
            if let Some((clock, writer)) = clock {
                writer.begin(turn, clock.page().now());
            }
            let served = station.serve(&mailbox);
            more |= served.more;
            held |= served.held;
            if served.sent {
                turn = Turn::None;
            }
        }
        if let Some((clock, writer)) = clock {
            let next = if held || first_turns > 0 {
                Some(0)
            } else {
                writer.next_instant()
            };
            first_turns = first_turns.saturating_sub(has_turn.into());
            ask(clock, has_turn, next);
        }
        if !more {
            doorbell.done(seen);
        }
        if let Some(looks) = &mut last_looks {
            *looks -= 1;
            if !more || *looks == 0 {
                break;
            }
        }
        // The doorbell does not ring where the service takes the turn itself, as it asks or kicks.
        more |= doorbell.clock().is_some_and(HostClock::has_turn);
        // Nobody rings if it has got the turn at once.
        let goes_on = more || clock.is_some_and(|(clock, _)| clock.has_turn());
        let limit = if goes_on { Timespec::default() } else { BEAT };
        let own = [&bell as &dyn AsFd, &signals.descriptor(), &ptys, &keyboards];
        wait(own, &stations, &limit).map_err(events)?;
        // All of them are looked at anyway; an error leaves the events for the next time.
        let mut events = Vec::with_capacity(16);
        let buffer = rustix::buffer::spare_capacity(&mut events);
        let _ = epoll::wait(&ptys, buffer, Some(&Timespec::default()));
        let mut events = [MaybeUninit::uninit(); 1024];
        let mut events = inotify::Reader::new(&keyboards, &mut events);
        while events.next().is_ok() {}
    }
    stations.iter_mut().for_each(Station::detach);
    Ok(())
}

/// Waits until one of the service's `own` descriptors or of its stations' has something, or for `limit`.
fn wait(own: [&dyn AsFd; 4], stations: &[Station], limit: &Timespec) -> Result<(), Errno> {
    let mut polled: Vec<_> = own
        .map(|it| PollFd::from_borrowed_fd(it.as_fd(), PollFlags::IN))
        .into();
    for (descriptor, flags) in stations.iter().flat_map(Station::descriptors) {
        polled.push(PollFd::from_borrowed_fd(descriptor, flags));
    }
    match rustix::event::poll(&mut polled, Some(limit)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error),
    }
}

/// Asks for the next turn, if one is needed, and returns the present one.
fn ask(clock: &HostClock, has_turn: bool, next: Option<u64>) {
    if has_turn {
        clock.postpone(next.unwrap_or(NEVER));
    } else if let Some(next) = next {
        clock.request(next);
    }
}

/// Types `characters` at the terminal of the processor `name`: adds them to a file, and returns without waiting for the
/// program. The terminal service passes them on. The program gets every character exactly once, even if the service is
/// killed meanwhile or does not run yet. Whether there is such a processor is not checked.
///
/// # Errors
/// Returns an error of the kind [`WouldBlock`](io::ErrorKind::WouldBlock) if so many characters wait for the
/// program that there is no room for these; none of them is typed. Returns the operating system's error if the
/// file cannot be written.
pub fn type_in(directory: &SystemDirectory, name: &str, characters: &[u8]) -> io::Result<()> {
    let mut keyboard = keyboard(directory, name)?;
    if keyboard.room(characters.len())? < characters.len() {
        let text = format!(
            "there is no room for {} more characters at the terminal of {name}: {} may wait for its \
             program; try again when it has read",
            characters.len(),
            typing::WAITING
        );
        return Err(io::Error::new(io::ErrorKind::WouldBlock, text));
    }
    keyboard.file.write_all(characters)
}

/// Begins the record of typing of a system that comes up in simulated time, and types `script`.
pub(crate) fn begin(
    directory: &SystemDirectory,
    script: Option<&Script>,
) -> Result<(), NamedFileError> {
    let write = |path: PathBuf, text: &str| {
        let written = WholeFile::write(&path, text);
        written.map_err(NamedFileError::at("write", &path))
    };
    write(directory.typing(), script::HEAD)?;
    let Some(script) = script else {
        return Ok(());
    };
    for (name, characters) in script.typed() {
        // All of it was typed before any program began; its length is that of a file.
        let typed = keyboard(directory, &name).and_then(|it| (&it.file).write_all(&characters));
        typed.map_err(NamedFileError::at("write", directory.terminals()))?;
    }
    write(directory.replay(), script.text())
}

/// Opens the terminal of the processor `name` for typing. Whether there is such a processor is not checked.
///
/// # Errors
/// Returns the operating system's error if the file cannot be opened.
pub fn keyboard(directory: &SystemDirectory, name: &str) -> io::Result<Keyboard> {
    Keyboard::open(&log(&directory.terminals(), name))
}

/// Returns the path of the log with the output of the processor `name`. `directory` is the directory of terminals,
/// [`SystemDirectory::terminals`].
#[must_use]
pub fn log(directory: &Path, name: &str) -> PathBuf {
    directory.join(format!("{name}.log"))
}
