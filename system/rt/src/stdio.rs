//! [`Stdio`]: the descriptors of a program, for its terminal, files of the host, and boards (A. I. Memo 977, section
//! 3.1).

use core::time::Duration;

use condor_dev::stdio::{BufReader, BufWriter, Buffering, LineError, WriteError};
use condor_dev::stream::{Descriptors, DeviceStream};
use condor_dev::{Bus, DeviceSet, Fd, FdError, InterruptController, OpenMode, Switch};
use condor_fs::{Errno, File, OpenOptions};
use condor_mbox::{Instant, Messenger as _};
use embedded_io::{ErrorType, Read, ReadExactError, ReadReady as _, Write};

use crate::descriptors::{DESCRIPTORS, Descriptor, STDERR, STDIN, STDOUT, StdioCause, StdioError};
use crate::machine::{Machine, MailboxOf};
use crate::running::{Background, ConsoleOf, FILES, FilesOf};
use crate::text::ShortText;

/// Bytes of each of the two buffers of a descriptor, and the longest line that is read.
const BUFFER: usize = 256;
/// The time for which a read, write or flush waits.
const PATIENCE: Duration = Duration::from_secs(1);
/// The longest time between two looks for a byte or for room.
const LOOK: Duration = Duration::from_millis(20);

/// The descriptors of a program: [`STDIN`], [`STDOUT`] and [`STDERR`] on its terminal, and those that it opens for files
/// of the host and for boards of a device switch. All are read, written and closed in the same way.
///
/// [`Background::stdio`] makes the table, which belongs to the background and needs no memory but its own, some 5 KiB.
/// Loops and handlers print without it: see [`LoopTick::print`](crate::LoopTick::print).
///
/// [`stream`](Self::stream) returns a descriptor with the traits of `embedded-io`, for `write!`. Each descriptor has a
/// buffer of 256 bytes for each direction. Bytes that a write has taken are passed on as its [`Buffering`] says. If that
/// fails, they are kept in order; the next write, [`flush`](Self::flush) or [`close`](Self::close) tries again, and
/// returns the error if it fails. This also holds for a file whose server did not answer in time: bytes that turn out to
/// be written are not written again.
///
/// A read, write or flush that must wait for a terminal or board serves messages meanwhile, and fails after one second. A
/// file waits for the host as long as its [`FileSystem`](condor_fs::FileSystem) may.
///
/// Dropping the table closes its files, but not its boards, and drops the bytes that it keeps: so close descriptors
/// before.
pub struct Stdio<'s, 'b, M: Machine> {
    background: &'s Background<'b, M>,
    files: Option<&'s FilesOf<'b, M>>,
    entries: [Entry<'s, 'b, M>; DESCRIPTORS],
}

/// The use of a number at present, and how often it was used before.
struct Entry<'s, 'b, M: Machine> {
    generation: u16,
    open: Option<Open<'s, 'b, M>>,
}

struct Open<'s, 'b, M: Machine> {
    name: ShortText<32>,
    mode: OpenMode,
    /// One buffer stands in the other, and both own what is behind them.
    buffers: BufWriter<BufReader<Target<'s, 'b, M>, BUFFER>, BUFFER>,
}

/// The terminal, file or board behind the buffers of a descriptor.
struct Target<'s, 'b, M: Machine> {
    background: &'s Background<'b, M>,
    /// The end of the wait of the present call.
    deadline: Instant,
    end: End<'s, 'b, M>,
}

enum End<'s, 'b, M: Machine> {
    Terminal(&'b ConsoleOf<M>),
    File {
        files: &'s FilesOf<'b, M>,
        file: File<'s, 'b, MailboxOf<'b, M>, M::Window, FILES>,
        /// The position of the next read.
        reads_at: u64,
        /// The position at which a write began whose end was not seen.
        begun: Option<u64>,
    },
    Board(&'s dyn Descriptors, Fd),
}

impl<'b, M: Machine> Background<'b, M> {
    /// Makes a table of descriptors, in which those of the terminal are open if the program has one. A program needs
    /// only one table: each has its own buffers.
    pub fn stdio<'s>(&'s self) -> Stdio<'s, 'b, M> {
        let (read, write) = (OpenMode::READ, OpenMode::WRITE);
        let mut stdio = Stdio {
            background: self,
            files: None,
            // Without a terminal, no other descriptor may be taken for one of its three.
            entries: core::array::from_fn(|_| Entry {
                generation: u16::from(self.console.is_none()),
                open: None,
            }),
        };
        if let Some(terminal) = self.console {
            for (descriptor, mode, buffering) in [
                (STDIN, read, Buffering::None),
                (STDOUT, write, Buffering::Line),
                (STDERR, write, Buffering::None),
            ] {
                let end = End::Terminal(terminal);
                stdio.put(descriptor.0.number(), "console", (mode, buffering), end);
            }
        }
        stdio
    }
}

impl<'s, 'b, M: Machine> Stdio<'s, 'b, M> {
    /// Has the table open files by `files`, the client that [`Background::files`] returns.
    #[must_use]
    pub const fn with_files(mut self, files: &'s FilesOf<'b, M>) -> Self {
        self.files = Some(files);
        self
    }

    /// Opens the file of the host at `path`. Reads begin at its beginning, and writes where `options` says: a file that
    /// is open for both has two positions.
    ///
    /// # Errors
    /// [`StdioError::Full`] if all descriptors are open; [`StdioError::NoFiles`] without
    /// [`with_files`](Self::with_files); [`StdioError::File`] if the file cannot be opened.
    pub fn open_file(
        &mut self,
        path: &str,
        options: OpenOptions,
        buffering: Buffering,
    ) -> Result<Descriptor, StdioError> {
        let number = self.free(path)?;
        let name = || ShortText::of(path);
        let files = self
            .files
            .ok_or_else(|| StdioError::NoFiles { name: name() })?;
        let file = (files.open(path, options)).map_err(|error| StdioError::File {
            name: name(),
            error,
        })?;
        let mut mode = OpenMode::empty();
        mode.set(OpenMode::READ, options.reads());
        mode.set(OpenMode::WRITE, options.writes());
        let end = End::File {
            files,
            file,
            reads_at: 0,
            begun: None,
        };
        Ok(self.put(number, path, (mode, buffering), end))
    }

    /// Opens board number `board` of the device `name` of `switch`, as [`Switch::open`] does.
    ///
    /// # Errors
    /// [`StdioError::Full`] if all descriptors are open; [`StdioError::Board`] if the switch refuses.
    pub fn open_board<B: Bus, C: InterruptController, D: DeviceSet, const F: usize>(
        &mut self,
        switch: &'s Switch<B, C, D, F>,
        (name, board): (&'static str, u8),
        mode: OpenMode,
        buffering: Buffering,
    ) -> Result<Descriptor, StdioError> {
        let number = self.free(name)?;
        let fd = switch.open(name, board, mode)?;
        Ok(self.put(number, name, (mode, buffering), End::Board(switch, fd)))
    }

    fn free(&self, name: &str) -> Result<u16, StdioError> {
        let mut entries = (0..).zip(&self.entries);
        let free = entries.find_map(|(number, entry)| entry.open.is_none().then_some(number));
        free.ok_or_else(|| StdioError::Full {
            name: ShortText::of(name),
        })
    }

    /// Fills an entry that is free.
    fn put(
        &mut self,
        number: u16,
        name: &str,
        (mode, buffering): (OpenMode, Buffering),
        end: End<'s, 'b, M>,
    ) -> Descriptor {
        let target = Target {
            background: self.background,
            deadline: Instant::from_ns(0),
            end,
        };
        let mut generation = 0;
        if let Some(entry) = self.entries.get_mut(usize::from(number)) {
            generation = entry.generation;
            entry.open = Some(Open {
                name: ShortText::of(name),
                mode,
                buffers: BufWriter::new(BufReader::new(target), buffering),
            });
        }
        Descriptor(Fd::new(number, generation))
    }

    /// Returns the descriptor with [`Read`] and [`Write`] of `embedded-io`.
    ///
    /// # Errors
    /// [`StdioError::Descriptor`] if it is not open.
    pub fn stream(&mut self, descriptor: Descriptor) -> Result<Stream<'_, 's, 'b, M>, StdioError> {
        if descriptor == STDIN
            && let Ok(screen) = self.stream(STDOUT)
        {
            screen.open.within(PATIENCE);
            // Kept for the next write, which reports it.
            let _ = screen.open.buffers.drain();
        }
        let (fd, entry) = (descriptor.0, self.entry(descriptor)?);
        let open = entry.open.as_mut().ok_or(FdError::Closed { fd })?;
        Ok(Stream { open, fd })
    }

    /// Reads a line into `into`, and returns it with its newline, which only the last line of a file may lack. Returns an
    /// empty text at the end of a file, or if the end of the input was typed. Waits at most `time` for the rest of the
    /// line, and then returns `None`; the next call continues the line. With [`Duration::ZERO`] it never waits for a
    /// terminal or board. From a board, a carriage return ends a line, too.
    ///
    /// # Errors
    /// [`StdioError::Line`] if the line is longer than `into` or 256 bytes, or not UTF-8: it is skipped.
    /// [`StdioError::Descriptor`] if the descriptor is not open for reading; [`StdioError::Failed`] if the terminal, file
    /// or board fails.
    pub fn read_line<'l>(
        &mut self,
        descriptor: Descriptor,
        into: &'l mut [u8],
        time: Duration,
    ) -> Result<Option<&'l str>, StdioError> {
        let Stream { open, fd } = self.stream(descriptor)?;
        open.allow(fd, OpenMode::READ)?;
        open.within(time);
        let returns = matches!(open.target().end, End::Board(..));
        let ends = |byte| byte == b'\n' || byte == b'\r' && returns;
        match open.buffers.inner_mut().read_line(ends, into) {
            Ok(line) => Ok(Some(line)),
            Err(LineError::Reader(StdioCause::TimedOut)) => Ok(None),
            Err(LineError::Reader(cause)) => Err(open.failed(cause)),
            Err(error) => Err(StdioError::Line {
                name: open.name.clone(),
                error,
            }),
        }
    }

    /// Passes on all bytes that were written, and waits until they are on the way: shown by the host if the terminal
    /// [blocks](condor_tty::Policy::Block), with the file service, or out of the board.
    ///
    /// # Errors
    /// [`StdioError::Unwritten`] if bytes are left; [`StdioError::Failed`] if all are passed on, but did not leave the
    /// terminal or board in time; [`StdioError::Descriptor`] if the descriptor is not open.
    pub fn flush(&mut self, descriptor: Descriptor) -> Result<(), StdioError> {
        self.stream(descriptor)?.flush()
    }

    /// Flushes a descriptor as [`flush`](Self::flush) does, and closes it.
    ///
    /// # Errors
    /// The error of `flush`; the descriptor stays open then. [`StdioError::Failed`] if the file or board returns an error
    /// when it is closed; the descriptor is closed all the same.
    pub fn close(&mut self, descriptor: Descriptor) -> Result<(), StdioError> {
        self.flush(descriptor)?;
        self.discard(descriptor).map(drop)
    }

    /// Closes a descriptor without a flush. Returns the number of bytes that were not passed on, and are lost.
    ///
    /// # Errors
    /// [`StdioError::Descriptor`] if the descriptor is not open. [`StdioError::Failed`] if the file or board returns an
    /// error when it is closed; the descriptor is closed all the same.
    pub fn discard(&mut self, descriptor: Descriptor) -> Result<usize, StdioError> {
        let (fd, entry) = (descriptor.0, self.entry(descriptor)?);
        let Open { name, buffers, .. } = entry.open.take().ok_or(FdError::Closed { fd })?;
        entry.generation = entry.generation.wrapping_add(1);
        let lost = buffers.held().len();
        let closed = match buffers.into_inner().into_inner().end {
            End::Terminal(_) => Ok(()),
            End::File { file, .. } => file.close().map_err(StdioCause::File),
            End::Board(switch, fd) => {
                (switch.close(fd)).map_err(|error| StdioCause::Board(error.into()))
            }
        };
        closed.map_err(|cause| StdioError::Failed { name, cause })?;
        Ok(lost)
    }

    fn entry(&mut self, Descriptor(fd): Descriptor) -> Result<&mut Entry<'s, 'b, M>, FdError> {
        let entry = self.entries.get_mut(usize::from(fd.number()));
        let entry = entry.filter(|entry| entry.generation == fd.generation());
        entry.ok_or(FdError::Closed { fd })
    }
}

impl<'s, 'b, M: Machine> Open<'s, 'b, M> {
    fn target(&mut self) -> &mut Target<'s, 'b, M> {
        self.buffers.inner_mut().inner_mut()
    }

    /// Begins a call that waits for at most `time`.
    fn within(&mut self, time: Duration) {
        let target = self.target();
        target.deadline = target.background.mailbox.now().after(time);
    }

    fn allow(&self, fd: Fd, wanted: OpenMode) -> Result<(), FdError> {
        let opened = self.mode;
        if opened.contains(wanted) {
            return Ok(());
        }
        Err(FdError::Direction { fd, wanted, opened })
    }

    fn failed(&self, cause: StdioCause) -> StdioError {
        let name = self.name.clone();
        StdioError::Failed { name, cause }
    }
}

/// An open descriptor of a [`Stdio`] with the traits of `embedded-io`; [`Stdio::stream`] returns it. Its calls wait for
/// at most one second each, as [`Stdio`] says. A write for which bytes of earlier writes cannot be passed on fails, and
/// takes nothing; of `write_all` and `write!`, a part may be taken then.
pub struct Stream<'t, 's, 'b, M: Machine> {
    open: &'t mut Open<'s, 'b, M>,
    fd: Fd,
}

impl<M: Machine> ErrorType for Stream<'_, '_, '_, M> {
    type Error = StdioError;
}

impl<M: Machine> Read for Stream<'_, '_, '_, M> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, StdioError> {
        self.open.allow(self.fd, OpenMode::READ)?;
        self.open.within(PATIENCE);
        let read = self.open.buffers.inner_mut().read(into);
        read.map_err(|cause| self.open.failed(cause))
    }

    // The default of `embedded-io`, without its path that panics.
    fn read_exact(&mut self, into: &mut [u8]) -> Result<(), ReadExactError<StdioError>> {
        let mut rest = into;
        while !rest.is_empty() {
            rest = match self.read(rest)? {
                0 => return Err(ReadExactError::UnexpectedEof),
                count => rest.get_mut(count..).unwrap_or_default(),
            };
        }
        Ok(())
    }
}

impl<M: Machine> Write for Stream<'_, '_, '_, M> {
    fn write(&mut self, from: &[u8]) -> Result<usize, StdioError> {
        self.open.allow(self.fd, OpenMode::WRITE)?;
        self.open.within(PATIENCE);
        let written = self.open.buffers.write(from);
        written.map_err(|error| self.open.failed(cause_of(error)))
    }

    // The default of `embedded-io`, without its path that panics.
    fn write_all(&mut self, from: &[u8]) -> Result<(), StdioError> {
        let mut rest = from;
        while !rest.is_empty() {
            let written = self.write(rest)?;
            rest = rest.get(written.max(1)..).unwrap_or_default();
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), StdioError> {
        if !self.open.mode.contains(OpenMode::WRITE) {
            return Ok(());
        }
        self.open.within(PATIENCE);
        let Err(error) = self.open.buffers.flush() else {
            return Ok(());
        };
        let cause = cause_of(error);
        Err(match self.open.buffers.held().len() {
            0 => self.open.failed(cause),
            bytes => StdioError::Unwritten {
                name: self.open.name.clone(),
                bytes,
                cause,
            },
        })
    }
}

/// A target that takes nothing returns an error.
fn cause_of(error: WriteError<StdioCause>) -> StdioCause {
    match error {
        WriteError::Writer(cause) => cause,
        WriteError::Zero => StdioCause::TimedOut,
    }
}

/// Serves messages for a while; returns an error at the deadline.
fn waits<M: Machine>(background: &Background<'_, M>, deadline: Instant) -> Result<(), StdioCause> {
    let left = Duration::from_nanos(deadline.ns_since(background.mailbox.now()));
    if left.is_zero() {
        return Err(StdioCause::TimedOut);
    }
    (background.serve(left.min(LOOK))).map_err(|_| StdioCause::Memory)
}

impl<M: Machine> ErrorType for Target<'_, '_, M> {
    type Error = StdioCause;
}

impl<M: Machine> Read for Target<'_, '_, M> {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, StdioCause> {
        let (background, deadline) = (self.background, self.deadline);
        match &mut self.end {
            End::Terminal(terminal) => {
                let console = terminal.console(background.mailbox);
                let mut console = console.with_read_timeout(Duration::ZERO);
                loop {
                    // A character that interrupts ends no read here: the line before it is gone.
                    if console.read_ready()?
                        && let Ok(read) = console.read(into)
                    {
                        return Ok(read);
                    }
                    waits(background, deadline)?;
                }
            }
            End::File { file, reads_at, .. } => {
                // By a position of its own: what timed out is read again.
                let read = file.read_at(into, *reads_at)?;
                *reads_at = reads_at.saturating_add(read as u64);
                Ok(read)
            }
            End::Board(switch, fd) => {
                let wait = || waits(background, deadline).is_ok();
                Ok(DeviceStream::new(*switch, *fd, wait).read(into)?)
            }
        }
    }
}

impl<M: Machine> Write for Target<'_, '_, M> {
    /// Gets the same bytes again, and perhaps more behind them, until it has taken them.
    fn write(&mut self, from: &[u8]) -> Result<usize, StdioCause> {
        let (background, deadline) = (self.background, self.deadline);
        match &mut self.end {
            End::Terminal(terminal) => Ok(terminal.console(background.mailbox).write(from)?),
            End::File {
                files, file, begun, ..
            } => {
                if let Some(before) = *begun {
                    let left = deadline.ns_since(background.mailbox.now());
                    // Its result may be told to another call; the position knows it.
                    files.settle(Duration::from_nanos(left))?;
                    let written = file.position()?.saturating_sub(before);
                    *begun = None;
                    if written > 0 {
                        return Ok(from.len().min(written as usize));
                    }
                }
                *begun = Some(file.position()?);
                let written = file.write(from)?;
                *begun = None;
                if written == 0 {
                    return Err(condor_fs::FileError::from(Errno::IO).into());
                }
                Ok(written)
            }
            End::Board(switch, fd) => {
                let wait = || waits(background, deadline).is_ok();
                Ok(DeviceStream::new(*switch, *fd, wait).write(from)?)
            }
        }
    }

    fn flush(&mut self) -> Result<(), StdioCause> {
        let (background, deadline) = (self.background, self.deadline);
        match &mut self.end {
            End::Terminal(terminal) => Ok(terminal.console(background.mailbox).flush()?),
            End::File { .. } => Ok(()),
            End::Board(switch, fd) => {
                let wait = || waits(background, deadline).is_ok();
                Ok(DeviceStream::new(*switch, *fd, wait).flush()?)
            }
        }
    }
}
