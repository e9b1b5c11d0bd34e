//! Every call of a client of the file service, once with success and once where it is refused.

use core::pin::Pin;
use core::task::{Context, Waker};

use checks::Checks;
use condor_fs::{
    AllocationMode, Buffer, BufferError, BufferResult, DirectoryEntry, Errno, File, FileError,
    FileSystem, OpenOptions, OperationResult, WriterError,
};
use condor_mbox::{Allocator, MemoryWindow as _, Messenger as _};
use embedded_io::{BufRead as _, Read as _, ReadExactError, Seek as _, SeekFrom, Write as _};

use crate::bell::{Mail, PATIENCE, SHORT};
use crate::host::CONTENT;
use crate::memory::{HOST, Window};
use crate::pair::{FILES, Pair};

/// The files of the processor, over its mailbox.
pub(crate) type System<'p> = FileSystem<'p, Mail<'p>, Window, FILES>;

const READ: OpenOptions = OpenOptions::new().read();
const BOTH: OpenOptions = OpenOptions::new().read().write();

/// Returns the error number of a call that failed with one.
fn errno<T>(outcome: Result<T, FileError>) -> Option<Errno> {
    outcome.err().and_then(|error| error.errno())
}

/// Gets a session, at the second attempt.
pub(crate) fn connect<'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
) -> Result<System<'p>, FileError> {
    checks.group("a session");
    let connect = |timeout| FileSystem::connect(pair.hand, HOST, pair.own, pair.area, timeout);
    pair.attentive.set(false);
    let before = pair.hand.now();
    let late = connect(SHORT).err();
    checks.that(matches!(
        late,
        Some(FileError::TimedOut { server: HOST, .. })
    ));
    let waited = pair.hand.now().ns_since(before);
    let in_time = (SHORT.as_nanos()..PATIENCE.as_nanos()).contains(&waited.into());
    checks.that(in_time);
    pair.attentive.set(true);
    pair.hand.serve(SHORT)?;
    pair.files.refuse(Errno::AGAIN);
    let system = connect(PATIENCE)?;
    pair.files.refuse(Errno::FAULT);
    checks.same(errno(system.status("run")), Some(Errno::FAULT));
    pair.files.fail(Errno::DQUOT);
    checks.same(errno(system.status("run")), Some(Errno::DQUOT));
    checks.that(!system.in_doubt());
    Ok(system)
}

/// Opens, reads and writes in all ways that copy.
#[inline(never)]
pub(crate) fn files(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), FileError> {
    checks.group("files");
    pair.files.fail(Errno::NOENT);
    checks.same(errno(system.open("run", READ)), Some(Errno::NOENT));
    let long = errno(system.open([b'x'; 33], READ));
    checks.same(long, Some(Errno::NAMETOOLONG));
    let mut run = system.open("run", BOTH.create().truncate().exclusive())?;
    checks.same(run.write(&[b'-'; 70]), Ok(64));
    checks.same(run.position(), Ok(64));
    let status = run
        .status()
        .map(|it| (it.size, it.is_file(), it.is_directory()));
    checks.same(status, Ok((CONTENT.len() as u64, true, false)));
    checks.same(run.truncate(4), Ok(()));
    checks.same(run.write_at(b"tendon", 7), Ok(6));
    checks.same(run.position(), Ok(64));
    let mut part = [0; 4];
    checks.same((run.read_at(&mut part, 7), &part), (Ok(4), b"3 is"));
    pair.files.fail(Errno::NXIO);
    checks.same(run.next_data(0), Ok(None));
    checks.same(run.next_hole(0), Ok(Some(0)));
    checks.same(run.allocate(AllocationMode::PunchHole, 0, 4), Ok(()));
    pair.files.fail(Errno::OPNOTSUPP);
    let refused = run.allocate(AllocationMode::Extend, 0, 4);
    checks.same(errno(refused), Some(Errno::OPNOTSUPP));
    checks.same(run.sync(), Ok(()));
    checks.same(run.write_all(CONTENT), Ok(()));
    checks.same(run.flush(), Ok(()));
    checks.that(write!(run, "{}", 98).is_ok());
    checks.same(run.rewind(), Ok(()));
    let mut word = [0; 6];
    let exact = run.read_exact(&mut word);
    checks.same((exact, &word), (Ok(()), b"tendon"));
    checks.same(run.stream_position(), Ok(6));
    checks.same(run.seek_relative(6), Ok(()));
    checks.same(run.seek(SeekFrom::End(-6)), Ok(12));
    let mut bytes = [0; 16];
    checks.same(run.read(&mut bytes), Ok(6));
    checks.same(run.read(&mut bytes), Ok(0));
    let exact = run.read_exact(&mut bytes);
    checks.same(exact, Err(ReadExactError::UnexpectedEof));
    let before = errno(File::seek(&mut run, SeekFrom::Current(-700)));
    checks.same(before, Some(Errno::INVAL));
    pair.files.fail(Errno::NOSPC);
    let failed = (errno(run.write(b"!")), run.position());
    checks.same(failed, (Some(Errno::NOSPC), Ok(18)));
    let mut second = system.open("run", OpenOptions::new().append())?;
    checks.same(second.write(b"tendon 4"), Ok(8));
    let third = system.open("run", READ)?;
    checks.same(errno(system.open("run", READ)), Some(Errno::MFILE));
    drop(third);
    checks.same(system.open("run", READ)?.close(), Ok(()));
    second.close()?;
    run.close()
}

/// Checks directories, and names that change.
#[inline(never)]
pub(crate) fn names(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), FileError> {
    checks.group("names");
    let mut fails = |call: &dyn Fn() -> Result<(), FileError>| {
        checks.same(call(), Ok(()));
        pair.files.fail(Errno::EXIST);
        checks.same(errno(call()), Some(Errno::EXIST));
    };
    fails(&|| system.make_directory("log"));
    fails(&|| system.remove_directory("log"));
    fails(&|| system.unlink("run"));
    fails(&|| system.rename("a", "b"));
    fails(&|| system.rename_new("a", "b"));
    fails(&|| system.exchange("a", "b"));
    fails(&|| system.status("run").map(drop));

    let mut directory = system.open_directory("log")?;
    let mut name = [0; 4];
    let first = DirectoryEntry {
        name: b"a",
        kind: 8,
    };
    checks.same(directory.next(&mut name), Ok(Some(first)));
    checks.same(errno(directory.next(&mut name)), Some(Errno::NAMETOOLONG));
    checks.same(directory.next(&mut name), Ok(None));
    checks.that(first.is_file() && !first.is_directory());
    directory.rewind();
    checks.same(directory.next(&mut name), Ok(Some(first)));
    directory.close()
}

/// Checks buffers that are lent, and operations whose end is not known.
#[inline(never)]
pub(crate) fn buffers(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
    allocator: &mut Allocator,
) -> Result<(), FileError> {
    checks.group("buffers");
    let buffer = Buffer::new(&pair.own, allocator, 32)?;
    let endless = Buffer::new(&pair.own, allocator, 4096);
    checks.that(endless.is_err());
    let mut file = system.open("data", BOTH)?;
    let (count, buffer) = file.read_buffer(buffer, 32).map_err(|kept| kept.error)?;
    let mut bytes = [0; CONTENT.len()];
    buffer.memory().read(0, &mut bytes)?;
    checks.that(count == 18 && bytes == *CONTENT);
    let (count, buffer) = file.write_buffer(buffer, 16).map_err(|kept| kept.error)?;
    checks.same((count, file.position()), (16, Ok(34)));
    pair.files.fail(Errno::IO);
    let (failed, buffer) = refused(file.write_buffer(buffer, 4));
    checks.that(failed == Some(Errno::IO) && buffer.is_some());
    let Some(buffer) = buffer else {
        return Ok(());
    };

    checks.group("doubt");
    system.set_timeout(SHORT);
    checks.same(system.settle(SHORT), Ok(None));
    pair.attentive.set(false);
    let late = file.write_buffer(buffer, 4);
    let kept = |late: &BufferResult<Window>| {
        let Err(BufferError { error, buffer }) = late else {
            return false;
        };
        matches!(error, FileError::TimedOut { .. }) && buffer.is_none()
    };
    checks.that(kept(&late));
    checks.that(system.in_doubt() && system.take_buffer().is_none());
    checks.that(matches!(
        system.settle(SHORT),
        Err(FileError::TimedOut { .. })
    ));
    checks.that(matches!(
        system.status("data"),
        Err(FileError::NotBegun { .. })
    ));
    pair.attentive.set(true);
    checks.same(system.settle(PATIENCE), Ok(Some(Ok(4))));
    system.set_timeout(PATIENCE);
    let buffer = Buffer::new(&pair.own, allocator, 32)?;
    let (busy, _) = refused(file.read_buffer(buffer, 4));
    checks.same(busy, Some(Errno::BUSY));
    checks.that(system.take_buffer().is_some());
    file.close()
}

/// Asks again for operations that have timed out, and awaits others.
#[inline(never)]
pub(crate) fn tickets(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), FileError> {
    checks.group("receipts");
    let late = |call: &dyn Fn() -> Option<FileError>| {
        system.set_timeout(SHORT);
        pair.attentive.set(false);
        let error = call();
        pair.attentive.set(true);
        system.set_timeout(PATIENCE);
        match error {
            Some(FileError::TimedOut { receipt, .. }) => Ok(receipt),
            _ => Err(Errno::IO),
        }
    };
    let receipt = late(&|| system.status("run").err())?;
    system.unlink("run")?;
    let answer = system.ticket(receipt, &mut []).wait(PATIENCE)?;
    checks.that(matches!(answer, OperationResult::Status(it) if it.size == CONTENT.len() as u64));
    let again = system.ticket(receipt, &mut []).wait(PATIENCE);
    checks.same(errno(again), Some(Errno::INVAL));
    let receipt = late(&|| system.open("run", READ).err())?;
    let OperationResult::File(file) = system.ticket(receipt, &mut []).wait(PATIENCE)? else {
        return Err(Errno::IO.into());
    };
    let receipt = late(&|| file.read_at(&mut [0; 6], 12).err())?;
    let mut bytes = [0; 6];
    let answer = system.ticket(receipt, &mut bytes).wait(PATIENCE)?;
    checks.that(matches!(answer, OperationResult::Number(6)) && &bytes == b"slack\n");

    checks.group("tickets");
    let mut context = Context::from_waker(Waker::noop());
    let mut read = file.begin_read_at(&mut bytes, 0);
    checks.that(read.receipt().is_none());
    pair.attentive.set(false);
    checks.that(Pin::new(&mut read).poll(&mut context).is_pending());
    checks.that(read.receipt().is_some() && system.in_doubt());
    checks.same(errno(system.status("run")), Some(Errno::BUSY));
    let mut other = system.begin_space();
    checks.that(Pin::new(&mut other).poll(&mut context).is_pending());
    pair.attentive.set(true);
    checks.same(read.wait(PATIENCE), Ok(6));
    drop(read);
    checks.same(&bytes, b"tendon");
    checks.that(other.wait(PATIENCE).is_ok());
    checks.same(errno(other.wait(PATIENCE)), Some(Errno::INVAL));
    drop(other);
    file.begin_close().wait(PATIENCE)
}

/// Returns the error number if the buffer was not read or written, and the buffer, either way.
fn refused(lent: BufferResult<Window>) -> (Option<Errno>, Option<Buffer<Window>>) {
    match lent {
        Ok((_, buffer)) => (None, Some(buffer)),
        Err(BufferError { error, buffer }) => (error.errno(), buffer),
    }
}

/// Checks readers and writers that make few calls of many.
#[inline(never)]
pub(crate) fn buffered(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), FileError> {
    checks.group("a buffered writer");
    let mut writer = system.open("hand", BOTH)?.writer();
    checks.that(writeln!(writer, "joint {}", 1).is_ok());
    checks.same(writer.held(), 8);
    checks.same(writer.write_all(&[b'-'; 60]), Ok(()));
    checks.same(writer.held(), 4);
    checks.same(writer.seek(SeekFrom::Start(0)), Ok(0));
    checks.same(writer.write(b"JOINT"), Ok(5));
    pair.files.fail(Errno::NOSPC);
    let Err(WriterError { error, writer }) = writer.into_inner() else {
        checks.that(false);
        return Ok(());
    };
    checks.same(error, Errno::NOSPC.into());
    let Some(mut writer) = writer else {
        checks.that(false);
        return Ok(());
    };
    system.set_timeout(SHORT);
    pair.attentive.set(false);
    checks.that(matches!(writer.flush(), Err(FileError::TimedOut { .. })));
    checks.same(writer.held(), 5);
    pair.attentive.set(true);
    system.set_timeout(PATIENCE);
    checks.same(writer.flush(), Ok(()));
    checks.same(writer.write(b"lost"), Ok(4));
    let mut rest = [0; 8];
    let Ok(parts) = writer.into_parts(&mut rest) else {
        checks.that(false);
        return Ok(());
    };
    checks.same((parts.held, parts.in_doubt), (4, false));
    checks.that(rest.starts_with(b"lost"));
    checks.same(parts.file.position(), Ok(parts.position));
    checks.that(parts.file.writer().close().is_ok());

    checks.group("a buffered reader");
    let mut reader = system.open("hand", READ)?.reader::<8>();
    checks.same(reader.fill_buf(), Ok(&CONTENT[..8]));
    reader.consume(6);
    let mut bytes = [0; 6];
    checks.same((reader.read_exact(&mut bytes), &bytes), (Ok(()), b" 3 is "));
    checks.same(reader.position(), Ok(12));
    checks.same(reader.stream_position(), Ok(12));
    checks.same(reader.seek(SeekFrom::Current(-6)), Ok(6));
    checks.same(reader.rewind(), Ok(()));
    checks.same(reader.read(&mut bytes), Ok(6));
    let file = reader.into_inner()?;
    checks.same(file.position(), Ok(6));
    file.close()
}
