//! [`Station`]: the terminal of one processor, with its log and with all who look at it.

use std::fs::File;
use std::io::ErrorKind;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Messenger, Processor, Region};
use condor_tty::ReaderError;
use condor_tty::linux::{Host, HostError, Pty, Sink, Unwatched};
use rustix::event::PollFlags;

use super::paper::Paper;
use super::typing;
use super::viewer::{Cursor, Viewer};
use crate::error::FileError;
use crate::services::ServiceError;
use condor_rt::numbers::TERMINALS;
use condor_rt::objects::{self, Kind};

/// How often a terminal is served before the others have their turn.
const TURNS: usize = 16;

pub(super) struct Station {
    processor: Processor,
    region: Region<LinuxWindow>,
    log: PathBuf,
    log_bytes: u64,
    attached: Option<Attached>,
    /// Why it could not be served the last time, so that this is told once.
    trouble: Option<String>,
    listener: UnixListener,
    viewers: Vec<Viewer>,
    pty: Pty,
    pty_cursor: Cursor,
    replay_bytes: u64,
    /// The log while nothing is attached.
    idle: Option<Paper>,
    /// Where all that is typed goes first.
    typed: File,
}

/// The sizes of a terminal's records.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// The number of bytes of earlier output that a new viewer gets.
    pub replay_bytes: u64,
    /// The size in bytes at which a log is rotated.
    pub log_bytes: u64,
}

/// What is left to do for a terminal.
#[derive(Clone, Copy, Default)]
pub(super) struct Served {
    /// There is more that can be done at once.
    pub(super) more: bool,
    /// A character could be sent if it were allowed.
    pub(super) types: bool,
}

struct Attached {
    offset: u32,
    host: Host<LinuxWindow, Paper>,
}

impl Station {
    pub(super) fn open(
        directory: &Path,
        name: &str,
        processor: Processor,
        region: Region<LinuxWindow>,
        Sizes {
            replay_bytes,
            log_bytes,
        }: Sizes,
    ) -> Result<Self, ServiceError> {
        let log = super::log(directory, name);
        let paper = Paper::open(&log, log_bytes).map_err(FileError::at("open", &log))?;
        let path = typing::file_of(&log);
        let typed = typing::open(&path).map_err(FileError::at("open", &path))?;
        let socket = directory.join(format!("{name}.sock"));
        let listener = listen(&socket).map_err(FileError::at("listen at", &socket))?;
        let link = directory.join(name);
        let pty = Pty::open(Unwatched::Discard).map_err(FileError::at("open", "a pty"))?;
        lead(&link, pty.path()).map_err(FileError::at("make", &link))?;
        Ok(Self {
            processor,
            region,
            log,
            log_bytes,
            attached: None,
            trouble: None,
            listener,
            viewers: Vec::new(),
            pty,
            pty_cursor: Cursor(paper.record.end_offset()),
            replay_bytes,
            idle: Some(paper),
            typed,
        })
    }

    pub(super) fn pty(&self) -> BorrowedFd<'_> {
        self.pty.as_fd()
    }

    pub(super) fn descriptors(&self) -> impl Iterator<Item = (BorrowedFd<'_>, PollFlags)> {
        let viewers = self.viewers.iter().map(Viewer::descriptor);
        core::iter::once((self.listener.as_fd(), PollFlags::IN)).chain(viewers)
    }

    /// Moves what there is in both directions; a character is sent only if `may_type`.
    pub(super) fn serve(&mut self, mailbox: &dyn Messenger, may_type: bool) -> Served {
        let served = self.attach().and_then(|()| {
            self.take_typed()?;
            self.serve_terminal(mailbox, may_type)
        });
        let served = match served {
            Ok(served) => {
                self.trouble = None;
                served
            }
            Err(error) => {
                self.give_up(&error);
                Served::default()
            }
        };
        self.show();
        served
    }

    /// Attaches to the terminal that the processor's directory names.
    fn attach(&mut self) -> Result<(), HostError> {
        let Some(offset) = self.find()? else {
            return Ok(());
        };
        if self
            .attached
            .as_ref()
            .is_some_and(|attached| attached.offset == offset)
        {
            return Ok(());
        }
        self.release();
        let paper = match self.idle.take() {
            Some(paper) => paper,
            None => Paper::open(&self.log, self.log_bytes)?,
        };
        let host = Host::attach(
            self.region.clone(),
            offset,
            self.processor,
            TERMINALS,
            paper,
        );
        match host {
            Ok(host) => {
                self.attached = Some(Attached { offset, host });
                Ok(())
            }
            // Its program is at it, and rings when it joins.
            Err(HostError::Reader(ReaderError::NotReady { .. })) => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn find(&self) -> Result<Option<u32>, HostError> {
        let mut first = None;
        for object in objects::all(&self.region)? {
            let object = object?;
            if object.kind == Kind::Terminal {
                if object.name.as_str() == "console" {
                    return Ok(Some(object.offset));
                }
                first = first.or(Some(object.offset));
            }
        }
        Ok(first)
    }

    fn take_typed(&mut self) -> Result<(), HostError> {
        let mut characters = [0; 1024];
        for viewer in &mut self.viewers {
            let count = viewer.typed(&mut characters);
            let characters = characters.get(..count).unwrap_or_default();
            typing::add(&mut self.typed, characters)?;
        }
        let count = self.pty.typed(&mut characters)?;
        let characters = characters.get(..count).unwrap_or_default();
        Ok(typing::add(&mut self.typed, characters)?)
    }

    fn serve_terminal(
        &mut self,
        mailbox: &dyn Messenger,
        may_type: bool,
    ) -> Result<Served, HostError> {
        let Some(Attached { host, .. }) = &mut self.attached else {
            return Ok(Served::default());
        };
        host.may_type(may_type);
        for _ in 0..TURNS {
            let served = host.serve(mailbox)?;
            if !served.more && served.input == 0 {
                let (more, types) = (false, served.types);
                return Ok(Served { more, types });
            }
        }
        let (more, types) = (true, false);
        Ok(Served { more, types })
    }

    fn give_up(&mut self, error: &HostError) {
        self.attached = None;
        self.idle = None;
        let text = error.to_string();
        if self.trouble.as_ref() != Some(&text) {
            eprintln!("terminal of {}: {text}", self.processor);
            self.trouble = Some(text);
        }
    }

    /// Lets go of the terminal, and keeps the log.
    fn release(&mut self) {
        if let Some(Attached { host, .. }) = self.attached.take() {
            // A terminal that has gone cannot be detached from.
            self.idle = host.detach().ok();
        }
    }

    pub(super) fn detach(mut self) {
        self.release();
    }

    /// Shows what is new in the log to all who look.
    fn show(&mut self) {
        if self.attached.is_none() && self.idle.is_none() {
            self.idle = Paper::open(&self.log, self.log_bytes).ok();
        }
        let record = match (&self.attached, &self.idle) {
            (Some(attached), _) => &attached.host.sink.record,
            (None, Some(paper)) => &paper.record,
            (None, None) => return,
        };
        let replay = record.end_offset().saturating_sub(self.replay_bytes);
        while let Ok((stream, _)) = self.listener.accept() {
            self.viewers.extend(Viewer::new(stream, replay).ok());
        }
        for viewer in &mut self.viewers {
            viewer.show(record);
        }
        self.viewers.retain(|viewer| !viewer.gone);
        if self.pty.is_watched().unwrap_or(false) {
            let pty = &mut self.pty;
            // It is there for who looks; the log has everything.
            let _ = self.pty_cursor.advance(record, |bytes| pty.take(bytes));
        } else {
            self.pty_cursor = Cursor(record.end_offset());
        }
    }
}

/// A socket in the place of one that a killed service left.
fn listen(path: &Path) -> std::io::Result<UnixListener> {
    remove(path)?;
    let listener = UnixListener::bind(path)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

fn lead(link: &Path, to: &Path) -> std::io::Result<()> {
    remove(link)?;
    std::os::unix::fs::symlink(to, link)
}

fn remove(path: &Path) -> std::io::Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
