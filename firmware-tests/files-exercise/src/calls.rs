//! Every call of a client of the file service, once with success and once where it is refused.

use checks::Checks;
use condor_fs::wire::Operation;
use condor_fs::{
    Buffer, Entry, Errno, Error, File, FileSystem, Kept, Lent, OpenOptions, Unwritten,
};
use condor_mbox::{MemoryWindow as _, Messenger as _, Places};
use embedded_io::{BufRead as _, Read as _, ReadExactError, Seek as _, SeekFrom, Write as _};

use crate::host::CONTENT;
use crate::memory::HOST;
use crate::pair::{FILES, Mail, PATIENCE, Pair, SHORT, Window};

/// The files of the processor, over its mailbox.
pub(crate) type System<'p> = FileSystem<'p, Mail<'p>, Window, FILES>;

const READ: OpenOptions = OpenOptions::new().read();
const BOTH: OpenOptions = OpenOptions::new().read().write();

/// Why a call did not do what it was asked to.
fn errno<T>(outcome: Result<T, Error>) -> Option<Errno> {
    outcome.err().and_then(|error| error.errno())
}

/// Gets a session, at the second attempt.
pub(crate) fn connect<'p>(checks: &mut Checks<'_>, pair: &Pair<'p>) -> Result<System<'p>, Error> {
    checks.group("a session");
    let connect = |timeout| FileSystem::connect(pair.hand, HOST, pair.own, pair.area, timeout);
    pair.attentive.set(false);
    let before = pair.hand.now();
    let late = connect(SHORT).err();
    let timed_out = matches!(late, Some(Error::TimedOut { server: HOST, .. }));
    checks.that("a host that does not answer is given up", timed_out);
    let waited = pair.hand.now().ns_since(before);
    let in_time = (SHORT.as_nanos()..PATIENCE.as_nanos()).contains(&waited.into());
    checks.that("in time, and not before", in_time);
    pair.attentive.set(true);
    pair.hand.serve(SHORT)?;
    pair.files.refuse(Errno::AGAIN);
    let system = connect(PATIENCE)?;
    pair.files.refuse(Errno::FAULT);
    let refused = errno(system.status("run"));
    checks.same("a refusal is the error", refused, Some(Errno::FAULT));
    pair.files.fail(Errno::DQUOT);
    let failed = errno(system.status("run"));
    checks.same("so is a failure", failed, Some(Errno::DQUOT));
    checks.that("nothing is in doubt", !system.in_doubt());
    Ok(system)
}

/// Opens, reads and writes in all ways that copy.
#[inline(never)]
pub(crate) fn files(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), Error> {
    checks.group("files");
    pair.files.fail(Errno::NOENT);
    checks.same(
        "what is not there is not opened",
        errno(system.open("run", READ)),
        Some(Errno::NOENT),
    );
    let long = errno(system.open([b'x'; 33], READ));
    checks.same(
        "nor by a name that is too long",
        long,
        Some(Errno::NAMETOOLONG),
    );
    let mut run = system.open("run", BOTH.create().truncate().exclusive())?;
    checks.same("it is opened", pair.files.last().0, Some(Operation::Open));
    checks.same(
        "as much as the buffer holds is written",
        run.write(&[b'-'; 70]),
        Ok(64),
    );
    let asked = (Some(Operation::Write), 0, 64);
    checks.same("by one request", pair.files.last(), asked);
    checks.same("the position moves", run.position(), Ok(64));
    let status = run
        .status()
        .map(|it| (it.size, it.is_file(), it.is_directory()));
    checks.same(
        "it has a status",
        status,
        Ok((CONTENT.len() as u64, true, false)),
    );
    checks.same("it is cut", run.truncate(4), Ok(()));
    checks.same(
        "to what was said",
        pair.files.last(),
        (Some(Operation::Truncate), 4, 0),
    );
    checks.same("it is synced", run.sync(), Ok(()));
    checks.same("all is written", run.write_all(CONTENT), Ok(()));
    checks.same("and flushed", run.flush(), Ok(()));
    checks.that("formatted text is written", write!(run, "{}", 98).is_ok());
    checks.same("it goes back", run.rewind(), Ok(()));
    let mut word = [0; 6];
    let exact = run.read_exact(&mut word);
    checks.same(
        "as much as is asked for is read",
        (exact, &word),
        (Ok(()), b"tendon"),
    );
    checks.same("it knows where it is", run.stream_position(), Ok(6));
    checks.same("it seeks by a step", run.seek_relative(6), Ok(()));
    checks.same("from the end", run.seek(SeekFrom::End(-6)), Ok(12));
    let mut bytes = [0; 16];
    checks.same("it is read there", run.read(&mut bytes), Ok(6));
    checks.same("at the end is nothing", run.read(&mut bytes), Ok(0));
    let exact = run.read_exact(&mut bytes);
    checks.same(
        "nor as much as one likes",
        exact,
        Err(ReadExactError::UnexpectedEof),
    );
    let before = errno(File::seek(&mut run, SeekFrom::Current(-700)));
    checks.same(
        "nothing is before the beginning",
        before,
        Some(Errno::INVAL),
    );
    pair.files.fail(Errno::NOSPC);
    let failed = (errno(run.write(b"!")), run.position());
    checks.same(
        "a failure moves nothing",
        failed,
        (Some(Errno::NOSPC), Ok(18)),
    );
    pair.files.lie(0);
    let nothing = run.write_all(b"x");
    checks.same(
        "a host that writes nothing ends it",
        nothing,
        Err(Errno::IO.into()),
    );
    pair.files.lie(1000);
    checks.same("no more is written than was given", run.write(b"01"), Ok(2));
    let mut second = system.open("run", OpenOptions::new().append())?;
    checks.same("another one appends", second.write(b"tendon 4"), Ok(8));
    checks.same("at the end", pair.files.last().0, Some(Operation::Append));
    let third = system.open("run", READ)?;
    checks.same(
        "the table is full",
        errno(system.open("run", READ)),
        Some(Errno::MFILE),
    );
    drop(third);
    checks.same(
        "what was dropped is closed",
        system.open("run", READ)?.close(),
        Ok(()),
    );
    second.close()?;
    run.close()
}

/// Directories, and names that change.
#[inline(never)]
pub(crate) fn names(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), Error> {
    checks.group("names");
    let failing = |call: &dyn Fn() -> Result<(), Error>, expected: Operation| {
        let well = call();
        let asked = pair.files.last().0;
        pair.files.fail(Errno::EXIST);
        well == Ok(()) && asked == Some(expected) && errno(call()) == Some(Errno::EXIST)
    };
    checks.that(
        "a directory is made, or not",
        failing(&|| system.make_directory("log"), Operation::MakeDirectory),
    );
    checks.that(
        "a directory is removed, or not",
        failing(
            &|| system.remove_directory("log"),
            Operation::RemoveDirectory,
        ),
    );
    checks.that(
        "a file is unlinked, or not",
        failing(&|| system.unlink("run"), Operation::Unlink),
    );
    checks.that(
        "it is renamed, or not",
        failing(&|| system.rename("a", "b"), Operation::Rename),
    );
    checks.that(
        "it gets a new name, or not",
        failing(&|| system.rename_new("a", "b"), Operation::Rename),
    );
    checks.that(
        "its status is told, or not",
        failing(&|| system.status("run").map(drop), Operation::PathStatus),
    );

    let mut directory = system.open_directory("log")?;
    let mut name = [0; 4];
    let first = Entry {
        name: b"a",
        kind: 8,
    };
    checks.same(
        "an entry is read",
        directory.next(&mut name),
        Ok(Some(first)),
    );
    let long = errno(directory.next(&mut name));
    checks.same("a longer name does not fit", long, Some(Errno::NAMETOOLONG));
    checks.same("there are no more", directory.next(&mut name), Ok(None));
    checks.that("a file is one", first.is_file() && !first.is_directory());
    directory.close()
}

/// Buffers that are lent, and operations whose end is not known.
#[inline(never)]
pub(crate) fn buffers(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
    places: &mut Places,
) -> Result<(), Error> {
    checks.group("buffers");
    let buffer = Buffer::new(&pair.own, places, 32)?;
    let endless = Buffer::new(&pair.own, places, 4096);
    checks.that("there is an end of room", endless.is_err());
    let mut file = system.open("data", BOTH)?;
    let (count, buffer) = file.read_buffer(buffer, 32).map_err(|kept| kept.error)?;
    let mut bytes = [0; CONTENT.len()];
    buffer.memory().read(0, &mut bytes)?;
    checks.that("one is read into", count == 18 && bytes == *CONTENT);
    let (count, buffer) = file.write_buffer(buffer, 16).map_err(|kept| kept.error)?;
    checks.same("and written", (count, file.position()), (16, Ok(34)));
    pair.files.fail(Errno::IO);
    let (failed, buffer) = refused(file.write_buffer(buffer, 4));
    checks.that(
        "a failure gives it back",
        failed == Some(Errno::IO) && buffer.is_some(),
    );
    let Some(buffer) = buffer else {
        return Ok(());
    };

    checks.group("doubt");
    system.set_timeout(SHORT);
    checks.same("nothing is to be settled", system.settle(SHORT), Ok(None));
    pair.attentive.set(false);
    let late = file.write_buffer(buffer, 4);
    let kept = |late: &Lent<Window>| {
        let Err(Kept { error, buffer }) = late else {
            return false;
        };
        matches!(error, Error::TimedOut { .. }) && buffer.is_none()
    };
    checks.that("a late answer keeps the buffer", kept(&late));
    checks.that(
        "it is in doubt",
        system.in_doubt() && system.take_buffer().is_none(),
    );
    let settled = system.settle(SHORT);
    checks.that(
        "it remains so",
        matches!(settled, Err(Error::TimedOut { .. })),
    );
    let waits = system.status("data");
    checks.that(
        "nothing is done before",
        matches!(waits, Err(Error::NotBegun { .. })),
    );
    pair.attentive.set(true);
    checks.same("it is settled", system.settle(PATIENCE), Ok(Some(Ok(4))));
    system.set_timeout(PATIENCE);
    let buffer = Buffer::new(&pair.own, places, 32)?;
    let (busy, _) = refused(file.read_buffer(buffer, 4));
    checks.same("the buffer is to be taken first", busy, Some(Errno::BUSY));
    checks.that("it is", system.take_buffer().is_some());
    file.close()
}

/// Why a buffer was not read or written, and the buffer, either way.
fn refused(lent: Lent<Window>) -> (Option<Errno>, Option<Buffer<Window>>) {
    match lent {
        Ok((_, buffer)) => (None, Some(buffer)),
        Err(Kept { error, buffer }) => (error.errno(), buffer),
    }
}

/// Readers and writers that make few calls of many.
#[inline(never)]
pub(crate) fn buffered(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), Error> {
    checks.group("a buffered writer");
    let mut writer = system.open("hand", BOTH)?.writer();
    let before = pair.files.asked().count;
    checks.that(
        "formatted text is taken",
        writeln!(writer, "joint {}", 1).is_ok(),
    );
    checks.same(
        "it is held",
        (writer.held(), pair.files.asked().count),
        (8, before),
    );
    checks.same("all is taken", writer.write_all(&[b'-'; 60]), Ok(()));
    checks.same("a full buffer is written", writer.held(), 4);
    checks.same(
        "a seek writes the rest",
        writer.seek(SeekFrom::Start(0)),
        Ok(0),
    );
    checks.same("some is taken", writer.write(b"JOINT"), Ok(5));
    pair.files.fail(Errno::NOSPC);
    let Err(Unwritten { error, writer }) = writer.into_inner() else {
        checks.that("a failure is told", false);
        return Ok(());
    };
    checks.same("a failure is told", error, Errno::NOSPC.into());
    let Some(mut writer) = writer else {
        checks.that("the writer comes back", false);
        return Ok(());
    };
    system.set_timeout(SHORT);
    pair.attentive.set(false);
    let late = writer.flush();
    checks.that(
        "a host is late",
        matches!(late, Err(Error::TimedOut { .. })),
    );
    checks.same("nothing is lost", writer.held(), 5);
    pair.attentive.set(true);
    system.set_timeout(PATIENCE);
    checks.same("it is written", writer.flush(), Ok(()));
    checks.that("it is closed", writer.close().is_ok());

    checks.group("a buffered reader");
    let mut reader = system.open("hand", READ)?.reader::<8>();
    checks.same("it holds some", reader.fill_buf(), Ok(&CONTENT[..8]));
    reader.consume(6);
    let mut bytes = [0; 6];
    let exact = reader.read_exact(&mut bytes);
    checks.same("the rest comes next", (exact, &bytes), (Ok(()), b" 3 is "));
    checks.same("its position is the reader's", reader.position(), Ok(12));
    checks.same("in any way", reader.stream_position(), Ok(12));
    checks.same("it goes back", reader.seek(SeekFrom::Current(-6)), Ok(6));
    checks.same("it rewinds", reader.rewind(), Ok(()));
    checks.same("it is read", reader.read(&mut bytes), Ok(6));
    let file = reader.into_inner()?;
    checks.same("the file is where the reader was", file.position(), Ok(6));
    file.close()
}
