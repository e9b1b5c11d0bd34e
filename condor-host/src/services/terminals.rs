//! The terminals of all processors: in a log, on a pseudo-terminal, and on a socket.
//!
//! For each processor there is in the directory `tty` of the running system
//!
//! | file | |
//! |---|---|
//! | `NAME.log` | all that the terminal has written; where a program began, or output was overwritten, a line in brackets says so |
//! | `NAME.old.log` | what was in the log until it was full; the one before is gone then |
//! | `NAME.sock` | sends who connects the end of the log, and then what comes; what is written to it is typed |
//! | `NAME` | leads to a pseudo-terminal with what comes; what is written to it is typed |
//! | `NAME.mark` | which byte of the output is where in the log |
//!
//! The terminal is the object `console` in the [directory](crate::directory) of the processor, or
//! else its first terminal.
//!
//! The log neither loses nor repeats a byte when the service is killed: the position in the output
//! follows from the length of the log. Sockets and pseudo-terminals are readers of the log, each as
//! fast as its program, so that none of them holds up the terminal.

mod record;
mod station;
mod viewer;

use std::os::fd::AsFd;
use std::path::Path;
use std::time::Duration;

use condor_mbox::{Mailbox, Processor, Region, SingleContext};
use condor_tty::Vectors;
use rustix::event::{PollFd, PollFlags, Timespec, epoll};
use rustix::io::Errno;

use super::{ServiceError, claim};
use crate::description::Description;
use crate::numbers::TERMINALS;
use crate::supervisor::Signals;
use crate::system::Directory;
pub use station::Sizes;
use station::Station;

/// How long to wait for events at most: the own heart must beat.
const BEAT: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 500_000_000,
};

/// Serves the terminals of these processors in the directory `directory` until SIGTERM.
///
/// # Errors
/// [`ServiceError`].
pub fn serve(
    directory: &Path,
    processors: &[(Processor, String)],
    sizes: Sizes,
) -> Result<(), ServiceError> {
    let mut signals = Signals::new().map_err(ServiceError::Events)?;
    let (windows, doorbell) = claim(TERMINALS)?.into_parts();
    // Pseudo-terminals that nobody has open would end every wait for their level.
    let ptys = epoll::create(epoll::CreateFlags::CLOEXEC)
        .map_err(|error| ServiceError::Events(error.into()))?;
    let mut stations = Vec::new();
    for (number, name) in processors {
        let Some(window) = windows.get(number.index()) else {
            continue;
        };
        let region =
            Region::users(window.data.clone()).map_err(|error| condor_mbox::Error::Window {
                processor: *number,
                object: condor_mbox::Object::Data,
                kind: error.kind,
            })?;
        let station = Station::open(directory, name, *number, region, sizes)?;
        let flags = epoll::EventFlags::IN | epoll::EventFlags::OUT | epoll::EventFlags::ET;
        let data = epoll::EventData::new_u64(0);
        epoll::add(&ptys, station.pty(), data, flags)
            .map_err(|error| ServiceError::Events(error.into()))?;
        stations.push(station);
    }
    let bell = doorbell.pollable();
    let mut mailbox = Mailbox::new(TERMINALS, windows, doorbell, SingleContext::new())?;
    mailbox.set_vector(Vectors::DEFAULT.output, &|_| 0, "terminal output")?;
    mailbox.join()?;
    mailbox.ring_always(true)?;
    while signals.taken() == 0 {
        bell.drain();
        mailbox.service(Duration::ZERO)?;
        let mut more = false;
        for station in &mut stations {
            more |= station.serve(&mailbox);
        }
        let mut polled = vec![
            PollFd::new(&bell, PollFlags::IN),
            PollFd::new(&ptys, PollFlags::IN),
            PollFd::from_borrowed_fd(signals.descriptor(), PollFlags::IN),
        ];
        for (descriptor, flags) in stations.iter().flat_map(Station::descriptors) {
            polled.push(PollFd::from_borrowed_fd(descriptor, flags));
        }
        let limit = if more { Timespec::default() } else { BEAT };
        match rustix::event::poll(&mut polled, Some(&limit)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(ServiceError::Events(error.into())),
        }
        quiet(&ptys);
    }
    for station in stations {
        station.detach();
    }
    Ok(())
}

/// Takes the events of pseudo-terminals, all of which are looked at anyway.
fn quiet(ptys: impl AsFd) {
    let mut events = Vec::with_capacity(16);
    let buffer = rustix::buffer::spare_capacity(&mut events);
    // An error leaves them for the next time.
    let _ = epoll::wait(ptys, buffer, Some(&Timespec::default()));
}

/// The arguments with which the program starts it.
pub(crate) fn arguments(description: &Description, directory: &Directory) -> Vec<String> {
    let mut arguments: Vec<String> = ["service", "terminals"].map(Into::into).into();
    let terminals = &description.terminals;
    for (option, bytes) in [
        ("--replay-bytes", terminals.replay_bytes),
        ("--log-bytes", terminals.log_bytes),
    ] {
        arguments.extend([option.into(), bytes.to_string()]);
    }
    arguments.push("--".into());
    arguments.push(directory.terminals().to_string_lossy().into_owned());
    for processor in &description.processors {
        arguments.push(format!("{}={}", processor.number, processor.name));
    }
    arguments
}
