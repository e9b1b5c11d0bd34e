//! [`FileReader`] and [`FileWriter`]: combine many small reads or writes into one call of the
//! server.

use core::fmt;

use condor_mbox::{MemoryWindow, Messenger};
use embedded_io::{BufRead, ErrorType, Read, ReadExactError, Seek, SeekFrom, Write};

use super::{File, FileError, whole};
use crate::errno::Errno;

/// A buffered reader of a file: it makes many small reads of a program into few requests to the
/// server. [`File::reader`] makes one.
///
/// One request reads as many bytes as the file's buffer in the [`Area`](super::Area) holds. `N`, a
/// multiple of four, is the size in bytes of a second buffer inside of the reader. The reader
/// copies bytes from the first to the second for [`BufRead::fill_buf`], because shared memory
/// cannot be borrowed as a slice.
///
/// Nothing is lost or read twice after an error or a timeout: if an operation that was in doubt
/// turns out to have read bytes, the next read returns them.
pub struct FileReader<
    'f,
    'm,
    S: Messenger + ?Sized,
    W: MemoryWindow,
    const FILES: usize,
    const N: usize,
> {
    file: File<'f, 'm, S, W, FILES>,
    /// The part of the file's buffer that was not taken out of it.
    left: Part,
    bytes: [u8; N],
    /// The part of `bytes` that was not given out.
    held: Part,
    begun: OperationStart,
}

/// A buffered writer of a file: it collects small writes in the file's buffer in shared memory. One
/// request to the server writes them when the buffer is full, or at [`Write::flush`].
/// [`File::writer`] makes one.
///
/// Nothing is lost by an error. A call of [`Write::write`] that fails has accepted none of its
/// bytes. Bytes that were accepted before, and are not written yet, are [held](Self::held) until a
/// later call writes them. This also holds after a timeout: bytes that turn out to have been
/// written are not written again.
///
/// Dropping the writer drops the bytes that it holds. [`close`](Self::close) and
/// [`into_inner`](Self::into_inner) return an error, with the writer, if bytes could not be
/// written.
pub struct FileWriter<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    file: File<'f, 'm, S, W, FILES>,
    /// The number of bytes in the file's buffer that are not written yet.
    held: u32,
    begun: OperationStart,
}

/// The error of a [`FileWriter`] that could not write the bytes that it holds, or could not close
/// its file.
pub struct WriterError<T> {
    /// The reason why the bytes could not be written.
    pub error: FileError,
    /// The writer, which still holds the unwritten bytes. It is `None` if all bytes were written
    /// and only closing the file failed.
    pub writer: Option<T>,
}

/// The file and the unwritten bytes that [`FileWriter::into_parts`] returns.
pub struct WriterParts<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> {
    /// The file that the writer wrote to.
    pub file: File<'f, 'm, S, W, FILES>,
    /// The number of bytes that the writer held: they are not known to be written.
    pub held: usize,
    /// The position in the file of the first of these bytes, in bytes from the beginning of the
    /// file. For a file that was opened for appending, it is the number of bytes that this open
    /// file has written before.
    pub position: u64,
    /// True if the last write is in doubt: some of the held bytes may turn out to be written.
    pub in_doubt: bool,
}

/// A range of a buffer.
#[derive(Clone, Copy, Default)]
struct Part {
    begin: u32,
    end: u32,
}

impl Part {
    const fn len(self) -> u32 {
        self.end.saturating_sub(self.begin)
    }
}

/// The position at which an operation began whose end has not been seen.
type OperationStart = Option<u64>;

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> File<'f, 'm, S, W, FILES> {
    /// Turns the file into a buffered reader, which begins at the file's position. `N` is the size
    /// of the reader's own buffer in bytes; it must be a multiple of four, and not 0.
    #[must_use]
    pub fn reader<const N: usize>(self) -> FileReader<'f, 'm, S, W, FILES, N> {
        const { assert!(N > 0 && N.is_multiple_of(4), "words come out of the window") };
        FileReader {
            file: self,
            left: Part::default(),
            bytes: [0; N],
            held: Part::default(),
            begun: None,
        }
    }

    /// Turns the file into a buffered writer, which collects bytes in the file's buffer in shared
    /// memory.
    #[must_use]
    pub fn writer(self) -> FileWriter<'f, 'm, S, W, FILES> {
        FileWriter {
            file: self,
            held: 0,
            begun: None,
        }
    }

    /// Returns the number of bytes that the operation in `begun` moved; waits for its end if it is in
    /// doubt.
    fn settled(&self, begun: &mut OperationStart) -> Result<u32, FileError> {
        let Some(before) = *begun else {
            return Ok(0);
        };
        let alone = self.system.enter()?;
        self.system.clear(&alone)?;
        *begun = None;
        let moved = alone.position(self.index)?.saturating_sub(before);
        Ok(u32::try_from(moved).map_or(self.capacity(), |moved| moved.min(self.capacity())))
    }

    /// Moves the first `len` bytes of the file's buffer; how many were moved.
    fn move_buffer(
        &self,
        reads: bool,
        len: u32,
        begun: &mut OperationStart,
    ) -> Result<u32, FileError> {
        *begun = Some(self.position()?);
        let buffer = self.system.own_buffer(self.index, len as usize);
        let moved = self.transfer_ahead(reads, buffer)?;
        *begun = None;
        Ok(u32::try_from(moved).map_or(len, |moved| moved.min(len)))
    }

    /// Returns the offset of the file's own buffer.
    fn buffer(&self) -> u32 {
        self.system.area.buffer(self.index)
    }

    fn capacity(&self) -> u32 {
        self.system.area.buffer_bytes()
    }
}

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, const N: usize>
    FileReader<'f, 'm, S, W, FILES, N>
{
    /// Returns the position of the next byte that the reader will return, in bytes from the
    /// beginning of the file.
    ///
    /// # Errors
    /// [`Errno::BUSY`] if another context's operation is in progress.
    pub fn position(&self) -> Result<u64, FileError> {
        Ok(self.file.position()?.saturating_sub(self.ahead()))
    }

    /// Returns the file. Its position is that of the next byte that the reader would have returned;
    /// bytes that were read ahead are dropped.
    ///
    /// # Errors
    /// [`FileError`] if the position is not known, because an earlier read is still in doubt or
    /// because an operation of another context is in progress. The file is dropped then.
    pub fn into_inner(mut self) -> Result<File<'f, 'm, S, W, FILES>, FileError> {
        self.seek(SeekFrom::Current(0))?;
        Ok(self.file)
    }

    /// Returns the number of bytes that were read ahead and not yet returned to the caller.
    fn ahead(&self) -> u64 {
        u64::from(self.left.len()).saturating_add(u64::from(self.held.len()))
    }

    /// Settles a read that was in doubt: the bytes that it turned out to have read are in the file's
    /// buffer.
    fn settle(&mut self) -> Result<(), FileError> {
        let end = self.file.settled(&mut self.begun)?;
        if end > 0 {
            self.left = Part { begin: 0, end };
        }
        Ok(())
    }

    /// Asks the server for more if all was taken out of the file's buffer.
    fn fetch(&mut self) -> Result<(), FileError> {
        self.settle()?;
        if self.left.len() > 0 {
            return Ok(());
        }
        let most = self.file.capacity();
        if most == 0 {
            return Err(Errno::INVAL.into());
        }
        let end = self.file.move_buffer(true, most, &mut self.begun)?;
        self.left = Part { begin: 0, end };
        Ok(())
    }

    /// Takes bytes out of the file's buffer: all that are left, or whole words.
    fn take(&mut self, into: Option<&mut [u8]>) -> Result<u32, FileError> {
        let (own, left) = (&self.file.system.own, self.left);
        let into = into.unwrap_or(&mut self.bytes);
        let mut len = u32::try_from(into.len()).map_or(left.len(), |most| most.min(left.len()));
        if len < left.len() {
            len &= !3;
        }
        let from = self.file.buffer().wrapping_add(left.begin);
        if let Some(into) = into.get_mut(..len as usize) {
            own.read(from, into)?;
        }
        self.left.begin = left.begin.wrapping_add(len);
        Ok(len)
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, const N: usize> ErrorType
    for FileReader<'_, '_, S, W, FILES, N>
{
    type Error = FileError;
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, const N: usize> BufRead
    for FileReader<'_, '_, S, W, FILES, N>
{
    /// At least one byte, none at the end of the file; [`Errno::INVAL`] if the area has no buffers.
    fn fill_buf(&mut self) -> Result<&[u8], FileError> {
        if self.held.len() == 0 {
            self.fetch()?;
            let end = self.take(None)?;
            self.held = Part { begin: 0, end };
        }
        let Part { begin, end } = self.held;
        Ok(self.bytes.get(begin as usize..end as usize).unwrap_or(&[]))
    }

    /// Drops the first `bytes` of the held bytes, all if there are fewer.
    fn consume(&mut self, bytes: usize) {
        let bytes = u32::try_from(bytes).unwrap_or(u32::MAX);
        self.held.begin = self.held.begin.saturating_add(bytes).min(self.held.end);
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, const N: usize> Read
    for FileReader<'_, '_, S, W, FILES, N>
{
    fn read(&mut self, into: &mut [u8]) -> Result<usize, FileError> {
        if into.is_empty() {
            return Ok(0);
        }
        if self.held.len() == 0 && into.len() >= N {
            self.fetch()?;
            return Ok(self.take(Some(into))? as usize);
        }
        let mut read = 0;
        for (place, byte) in into.iter_mut().zip(self.fill_buf()?) {
            *place = *byte;
            read += 1;
        }
        self.consume(read);
        Ok(read)
    }

    fn read_exact(&mut self, into: &mut [u8]) -> Result<(), ReadExactError<FileError>> {
        whole::read_exact(into, |rest| self.read(rest))
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize, const N: usize> Seek
    for FileReader<'_, '_, S, W, FILES, N>
{
    /// Drops the bytes that were read ahead.
    fn seek(&mut self, to: SeekFrom) -> Result<u64, FileError> {
        self.settle()?; // The position is not known before.
        let to = match to {
            SeekFrom::Current(step) => {
                let position = self.position()?.checked_add_signed(step);
                SeekFrom::Start(position.ok_or(Errno::INVAL)?)
            }
            other => other,
        };
        let position = self.file.seek(to)?;
        self.left = Part::default();
        self.held = Part::default();
        Ok(position)
    }

    fn stream_position(&mut self) -> Result<u64, FileError> {
        self.settle()?;
        self.position()
    }
}

impl<'f, 'm, S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize>
    FileWriter<'f, 'm, S, W, FILES>
{
    /// Returns the number of bytes that the writer has accepted and that are not known to be
    /// written.
    #[must_use]
    pub const fn held(&self) -> u32 {
        self.held
    }

    /// Writes the bytes that the writer holds, and returns the file.
    ///
    /// # Errors
    /// [`WriterError`] with the error and the writer if the bytes cannot be written.
    pub fn into_inner(mut self) -> Result<File<'f, 'm, S, W, FILES>, WriterError<Self>> {
        match self.flush() {
            Ok(()) => Ok(self.file),
            Err(error) => Err(WriterError {
                error,
                writer: Some(self),
            }),
        }
    }

    /// Writes the bytes that the writer holds, and closes the file.
    ///
    /// # Errors
    /// [`WriterError`] with the writer if not all bytes were written; [`WriterError`] without the
    /// writer if closing the file failed.
    pub fn close(self) -> Result<(), WriterError<Self>> {
        let writer = None;
        (self.into_inner()?.close()).map_err(|error| WriterError { error, writer })
    }

    /// Takes the writer apart without writing: copies the bytes that it holds to `rest`, and
    /// returns the file and the number of these bytes. Use this function after an error, to write
    /// the bytes elsewhere or to discard them.
    ///
    /// If the last write is in doubt, the file's position later tells how many of the bytes were
    /// written after all: when the doubt ends, the position moves by that number from
    /// [`WriterParts::position`].
    ///
    /// # Errors
    /// [`WriterError`] with the writer: [`Errno::INVAL`] if `rest` is too short; [`Errno::BUSY`] if
    /// an operation of another context is in progress; [`FileError::Access`] if the window fails.
    pub fn into_parts(
        self,
        rest: &mut [u8],
    ) -> Result<WriterParts<'f, 'm, S, W, FILES>, WriterError<Self>> {
        let (system, at) = (self.file.system, self.file.buffer());
        let held = self.held as usize;
        let copied = (self.file.position()).and_then(|position| {
            let rest = rest.get_mut(..held).ok_or(Errno::INVAL)?;
            system.own.read(at, rest)?;
            Ok(self.begun.unwrap_or(position))
        });
        match copied {
            Ok(position) => Ok(WriterParts {
                in_doubt: self.begun.is_some(),
                file: self.file,
                held,
                position,
            }),
            Err(error) => Err(WriterError {
                error,
                writer: Some(self),
            }),
        }
    }

    /// Takes off what was written of an operation that was in doubt.
    fn settle(&mut self) -> Result<(), FileError> {
        let written = self.file.settled(&mut self.begun)?;
        self.forget(written)
    }

    /// The first `written` bytes of what is held are with the server.
    fn forget(&mut self, written: u32) -> Result<(), FileError> {
        let left = self.held.saturating_sub(written);
        if written > 0 {
            let (system, at) = (self.file.system, self.file.buffer());
            for n in 0..left {
                let byte = system.byte(at.wrapping_add(written).wrapping_add(n))?;
                system.put_byte(at.wrapping_add(n), byte)?;
            }
        }
        self.held = left;
        Ok(())
    }

    fn drain(&mut self) -> Result<(), FileError> {
        self.settle()?;
        while self.held > 0 {
            let written = (self.file).move_buffer(false, self.held, &mut self.begun)?;
            if written == 0 {
                return Err(Errno::IO.into());
            }
            self.forget(written)?;
        }
        Ok(())
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> ErrorType
    for FileWriter<'_, '_, S, W, FILES>
{
    type Error = FileError;
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Write
    for FileWriter<'_, '_, S, W, FILES>
{
    /// Takes at least one byte; [`Errno::INVAL`] if the area has no buffers.
    fn write(&mut self, from: &[u8]) -> Result<usize, FileError> {
        if from.is_empty() {
            return Ok(0);
        }
        // The buffer must not change while the server may be reading it, or writing to it for a call
        // of the file before.
        self.settle()?;
        if self.held == 0 {
            let alone = self.file.system.enter()?;
            self.file.system.clear(&alone)?;
            alone.use_buffer(self.file.index);
        }
        let capacity = self.file.capacity();
        if self.held >= capacity {
            self.drain()?;
        }
        let (system, at) = (self.file.system, self.file.buffer());
        let room = capacity.saturating_sub(self.held) as usize;
        let from = from.get(..room).unwrap_or(from);
        if from.is_empty() {
            return Err(Errno::INVAL.into());
        }
        // Up to the next word by bytes: the words before it are not to be written again.
        let begin = at.wrapping_add(self.held);
        let (bytes, words) = from.split_at(from.len().min((begin.wrapping_neg() & 3) as usize));
        for (place, byte) in (begin..).zip(bytes) {
            system.put_byte(place, *byte)?;
        }
        if !words.is_empty() {
            system
                .own
                .write(begin.wrapping_add(bytes.len() as u32), words)?;
        }
        self.held = self.held.wrapping_add(from.len() as u32);
        Ok(from.len())
    }

    /// After an error, some of `from` may be taken.
    fn write_all(&mut self, from: &[u8]) -> Result<(), FileError> {
        whole::write_all(from, |rest| self.write(rest))
    }

    fn flush(&mut self) -> Result<(), FileError> {
        self.drain()
    }
}

impl<S: Messenger + ?Sized, W: MemoryWindow, const FILES: usize> Seek
    for FileWriter<'_, '_, S, W, FILES>
{
    /// Writes the held bytes before.
    fn seek(&mut self, to: SeekFrom) -> Result<u64, FileError> {
        self.drain()?;
        self.file.seek(to)
    }
}

impl<T> fmt::Debug for WriterError<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A text of its own would be printed by code that can panic.
        let writer = self.writer.as_ref().map(|_| format_args!(".."));
        (f.debug_struct("Unwritten").field("error", &self.error))
            .field("writer", &writer)
            .finish()
    }
}

impl<T> fmt::Display for WriterError<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.error.fmt(f)
    }
}

impl<T> core::error::Error for WriterError<T> {}
