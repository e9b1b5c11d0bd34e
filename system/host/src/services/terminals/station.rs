//! [`Station`]: the terminal of one processor, with its log and its viewers.

use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Messenger, Processor, Region};
use condor_tty::TerminalReaderError;
use condor_tty::linux::{HostError, Piece, Pty, ServedTerminal, Sink, TerminalHost};
use rustix::event::PollFlags;

use super::record::Record;
use super::script::ScriptWriter;
use super::typing::Typing;
use super::viewer::{Cursor, Viewer};
use crate::description::TerminalSizes;
use crate::error::NamedFileError;
use crate::services::ServiceError;
use condor_rt::numbers::TERMINALS;
use condor_rt::objects::{self, ObjectKind};

/// The time for which a terminal that could not be served is left alone.
const REST: Duration = Duration::from_millis(100);

pub(super) struct Station {
    processor: Processor,
    region: Region<LinuxWindow>,
    log: PathBuf,
    sizes: TerminalSizes,
    /// The name of the terminal and its record, in simulated time.
    writer: Option<(String, Rc<ScriptWriter>)>,
    host: Option<TerminalHost<LinuxWindow>>,
    /// None if they could not be opened again after an error.
    files: Option<Files>,
    /// The reason why the terminal could not be served the last time; a reason is reported
    /// once.
    trouble: Option<String>,
    /// Until when it is not served, after an error: whoever tries again at once would do nothing else, and
    /// keep simulated time from going on.
    rests_until: Option<Instant>,
    /// Characters that were read from a viewer or the pseudo-terminal, and are not in the file yet.
    unwritten: Vec<u8>,
    listener: UnixListener,
    viewers: Vec<Viewer>,
    /// Which of them is read first: one that had no room before the others had some more.
    turn: usize,
    /// Whether there was room for more typed characters the last time.
    has_room: bool,
    pty: Pty,
    pty_cursor: Cursor,
}

/// The output of a terminal and the characters typed there, both in files that outlive the service.
struct Files {
    record: Record,
    typing: Typing,
}

impl Files {
    fn open(
        log: &Path,
        sizes: TerminalSizes,
        writer: Option<(String, Rc<ScriptWriter>)>,
    ) -> io::Result<Self> {
        Ok(Self {
            record: Record::open(log, sizes.log_bytes.into())?,
            typing: Typing::open(log, writer)?,
        })
    }
}

impl Sink for Files {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        self.record.take(piece)
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.typing.read(into)
    }

    fn sends(&mut self, character: u8, waiting: usize) -> io::Result<bool> {
        self.typing.sends(character, waiting)
    }

    fn typing(&mut self, incarnation: u32, taken: u32, waiting: usize) -> io::Result<()> {
        self.typing.begin(incarnation, taken, waiting)
    }
}

impl Station {
    pub(super) fn open(
        directory: &Path,
        name: &str,
        processor: Processor,
        region: Region<LinuxWindow>,
        sizes: TerminalSizes,
        writer: Option<Rc<ScriptWriter>>,
    ) -> Result<Self, ServiceError> {
        let log = super::log(directory, name);
        let writer = writer.map(|writer| (name.to_owned(), writer));
        let files =
            Files::open(&log, sizes, writer.clone()).map_err(NamedFileError::at("open", &log))?;
        let socket = directory.join(format!("{name}.sock"));
        let listener = listen(&socket).map_err(NamedFileError::at("listen at", &socket))?;
        let link = directory.join(name);
        let pty = Pty::open().map_err(NamedFileError::at("open", "a pty"))?;
        lead(&link, pty.path()).map_err(NamedFileError::at("make", &link))?;
        Ok(Self {
            processor,
            region,
            log,
            sizes,
            writer,
            host: None,
            trouble: None,
            rests_until: None,
            unwritten: Vec::new(),
            listener,
            viewers: Vec::new(),
            turn: 0,
            has_room: true,
            pty,
            pty_cursor: Cursor(files.record.end_offset()),
            files: Some(files),
        })
    }

    pub(super) fn pty(&self) -> BorrowedFd<'_> {
        self.pty.as_fd()
    }

    pub(super) fn descriptors(&self) -> impl Iterator<Item = (BorrowedFd<'_>, PollFlags)> {
        let has_room = self.has_room;
        let viewers = self.viewers.iter();
        let viewers = viewers.filter_map(move |viewer| viewer.descriptor(has_room));
        core::iter::once((self.listener.as_fd(), PollFlags::IN)).chain(viewers)
    }

    /// Moves what there is in both directions.
    pub(super) fn serve(&mut self, mailbox: &dyn Messenger) -> ServedTerminal {
        if self.rests_until.is_some_and(|end| Instant::now() < end) {
            return ServedTerminal::default();
        }
        let outcome = self.move_bytes(mailbox);
        let trouble = outcome.as_ref().err().map(ToString::to_string);
        if let Some(text) = &trouble {
            if self.trouble != trouble {
                eprintln!("terminal of {}: {text}", self.processor);
            }
            self.rests_until = Some(Instant::now() + REST);
            // Nobody is asked to type meanwhile.
            self.has_room = false;
            self.host = None;
            self.files = Files::open(&self.log, self.sizes, self.writer.clone()).ok();
        }
        self.trouble = trouble;
        self.show();
        outcome.unwrap_or_default()
    }

    fn move_bytes(&mut self, mailbox: &dyn Messenger) -> Result<ServedTerminal, HostError> {
        self.attach()?;
        let files = match &mut self.files {
            Some(files) => files,
            none => none.insert(Files::open(&self.log, self.sizes, self.writer.clone())?),
        };
        // All that is typed goes to the file first. While that is full, it stays where it is, and who
        // writes there waits.
        files.typing.add(&mut self.unwritten)?;
        let mut characters = [0; 1024];
        let places = self.viewers.len() + 1;
        for place in (0..places).map(|step| (self.turn + step) % places) {
            if !files.typing.has_room()? {
                self.turn = place;
                break;
            }
            // The pseudo-terminal comes behind all viewers.
            let count = match self.viewers.get_mut(place) {
                Some(viewer) => viewer.typed(&mut characters),
                None => self.pty.typed(&mut characters)?,
            };
            self.unwritten.extend(characters.iter().take(count));
            files.typing.add(&mut self.unwritten)?;
        }
        self.has_room = files.typing.has_room()?;
        if !self.has_room {
            self.viewers.iter_mut().for_each(Viewer::look);
        }
        let Some(host) = &mut self.host else {
            return Ok(ServedTerminal::default());
        };
        host.serve(mailbox, files)
    }

    /// Attaches to the terminal that the processor's directory names.
    fn attach(&mut self) -> Result<(), HostError> {
        let Some(offset) = self.find()? else {
            return Ok(());
        };
        if self
            .host
            .as_ref()
            .is_some_and(|host| host.offset() == offset)
        {
            return Ok(());
        }
        self.detach();
        match TerminalHost::attach(self.region.clone(), offset, self.processor, TERMINALS) {
            Ok(host) => self.host = Some(host),
            // Its program is at it, and rings when it joins.
            Err(TerminalReaderError::NotReady { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        Ok(())
    }

    fn find(&self) -> Result<Option<u32>, HostError> {
        let mut first = None;
        for object in objects::all(&self.region)? {
            let object = object?;
            if object.kind == ObjectKind::Terminal {
                if object.name.as_str() == "console" {
                    return Ok(Some(object.offset));
                }
                first = first.or(Some(object.offset));
            }
        }
        Ok(first)
    }

    pub(super) fn detach(&mut self) {
        if let Some(host) = self.host.take() {
            if let Some(files) = &mut self.files {
                files.typing.put_back(host.waiting_input());
            }
            // A terminal that has gone cannot be detached from.
            let _ = host.detach();
        }
    }

    /// Shows what is new in the log to all who look.
    fn show(&mut self) {
        let Some(Files { record, .. }) = &self.files else {
            return;
        };
        let replay = record
            .end_offset()
            .saturating_sub(self.sizes.replay_bytes.into());
        while let Ok((stream, _)) = self.listener.accept() {
            self.viewers.extend(Viewer::new(stream, replay).ok());
        }
        for viewer in &mut self.viewers {
            viewer.show(record);
        }
        self.viewers.retain(|viewer| !viewer.gone);
        let pty = &mut self.pty;
        // The pseudo-terminal is for people who look; the log has everything.
        let _ = self
            .pty_cursor
            .advance(record, |bytes| pty.take(bytes.into()));
    }
}

/// A socket in the place of one that a killed service left.
fn listen(path: &Path) -> io::Result<UnixListener> {
    remove(path)?;
    let listener = UnixListener::bind(path)?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

fn lead(link: &Path, to: &Path) -> io::Result<()> {
    remove(link)?;
    std::os::unix::fs::symlink(to, link)
}

fn remove(path: &Path) -> io::Result<()> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
