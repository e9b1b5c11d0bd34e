//! Sessions, and open files.

use checks::Checks;
use condor_fs::{Errno, Error, File, FileSystem, OpenOptions};
use condor_mbox::{MemoryWindow, Messenger};
use embedded_io::{Read as _, ReadExactError, Seek as _, SeekFrom, Write as _};

use crate::memory::HOST;
use crate::pair::{FILES, Mail, PATIENCE, Pair, SHORT, Window};

/// The files of the processor, over its mailbox.
pub(crate) type System<'p> = FileSystem<'p, Mail<'p>, Window, FILES>;

const READ: OpenOptions = OpenOptions::new().read();
const BOTH: OpenOptions = OpenOptions::new().read().write();

/// Why a call did not do what it was asked to.
pub(crate) fn errno<T>(outcome: Result<T, Error>) -> Option<Errno> {
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
    checks.that(
        "in time, and not before",
        (SHORT.as_nanos()..PATIENCE.as_nanos()).contains(&waited.into()),
    );
    pair.attentive.set(true);
    pair.hand.serve(SHORT)?;
    pair.server.refuse(Errno::AGAIN);
    let before = pair
        .server
        .requests
        .load(core::sync::atomic::Ordering::Relaxed);
    let system = connect(PATIENCE)?;
    let after = pair
        .server
        .requests
        .load(core::sync::atomic::Ordering::Relaxed);
    checks.same(
        "one that recovers is asked again",
        after.wrapping_sub(before),
        2,
    );
    pair.server.refuse(Errno::FAULT);
    checks.same(
        "a refusal is the error",
        errno(system.status("run")),
        Some(Errno::FAULT),
    );
    pair.server.fail(Errno::DQUOT);
    checks.same(
        "so is a failure",
        errno(system.status("run")),
        Some(Errno::DQUOT),
    );
    checks.that("nothing is in doubt", !system.in_doubt());
    Ok(system)
}

/// Opens, reads and writes in all ways that copy.
#[inline(never)]
pub(crate) fn files(checks: &mut Checks<'_>, system: &System<'_>) -> Result<(), Error> {
    checks.group("files");
    checks.same(
        "what is not there is not opened",
        errno(system.open("run", READ)),
        Some(Errno::NOENT),
    );
    checks.same(
        "nor without a name",
        errno(system.open("", READ)),
        Some(Errno::NOENT),
    );
    let long = system.open([b'x'; 33], READ);
    checks.same(
        "nor by one that is too long",
        errno(long),
        Some(Errno::NAMETOOLONG),
    );
    checks.same(
        "nor what a link names",
        errno(system.open("latest", READ)),
        Some(Errno::LOOP),
    );

    let mut run = system.open("run", BOTH.create())?;
    checks.same(
        "as much as the buffer holds is written",
        run.write(&[b'-'; 70]),
        Ok(64),
    );
    checks.same("the position moves", run.position(), Ok(64));
    checks.same(
        "and the size",
        run.status().map(|it| (it.size, it.is_file())),
        Ok((64, true)),
    );
    checks.same("it is cut", run.truncate(4), Ok(()));
    checks.same("the position goes back", run.rewind(), Ok(()));
    checks.same(
        "all is written",
        run.write_all(b"tendon 3 is slack\n"),
        Ok(()),
    );
    checks.same("and flushed", run.flush(), Ok(()));
    checks.same("and synced", run.sync(), Ok(()));
    checks.same("it seeks from the end", run.seek(SeekFrom::End(-6)), Ok(12));
    same_bytes(checks, "it is read there", &mut run, b"slack\n")?;
    let mut end = [0; 4];
    checks.same("at the end is nothing", run.read(&mut end), Ok(0));
    checks.same(
        "it seeks from here",
        File::seek(&mut run, SeekFrom::Current(-18)),
        Ok(0),
    );
    checks.same("it knows where it is", run.stream_position(), Ok(0));
    let mut word = [0; 6];
    let exact = run.read_exact(&mut word).is_ok();
    checks.that(
        "as much as is asked for is read",
        exact && word == *b"tendon",
    );
    checks.same(
        "not before the beginning",
        errno(run.seek(SeekFrom::Current(-7))),
        Some(Errno::INVAL),
    );
    checks.same(
        "nor past all ends",
        errno(run.seek(SeekFrom::Start(u64::MAX))),
        Some(Errno::INVAL),
    );
    checks.same(
        "behind the end is nothing",
        run.seek(SeekFrom::Start(1000))
            .and_then(|_| run.read(&mut end)),
        Ok(0),
    );
    checks.same(
        "a disk that is full says so",
        errno(run.write(b"!")),
        Some(Errno::NOSPC),
    );
    checks.same("it is closed", run.close(), Ok(()));
    Ok(())
}

/// Several open files, and what the host may say.
#[inline(never)]
pub(crate) fn several(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
) -> Result<(), Error> {
    checks.group("several open files");
    let mut end = [0; 4];
    checks.same(
        "what exists is not made",
        errno(system.open("run", BOTH.exclusive())),
        Some(Errno::EXIST),
    );
    let mut reader = system.open("run", READ)?;
    checks.same(
        "a reader does not write",
        errno(reader.write(b"x")),
        Some(Errno::BADF),
    );
    {
        let mut first = system.open("run", OpenOptions::new().append())?;
        let mut second = system.open("run", OpenOptions::new().append())?;
        checks.same(
            "no more than the table has",
            errno(system.open("run", READ)),
            Some(Errno::MFILE),
        );
        checks.same("one appends", first.write(b"tendon 4 "), Ok(9));
        checks.same("the other one, too", second.write(b"broke\n"), Ok(6));
        checks.same("the first one again", first.write(b"again"), Ok(5));
        checks.same(
            "a writer does not read",
            errno(second.read(&mut end)),
            Some(Errno::BADF),
        );
    }
    reader.seek(SeekFrom::Start(18))?;
    same_bytes(
        checks,
        "all of it is there",
        &mut reader,
        b"tendon 4 broke\nagain",
    )?;
    let mut cut = system.open("run", OpenOptions::new().write().truncate())?;
    checks.same(
        "what was dropped is closed by the next open",
        cut.status().map(|it| it.size),
        Ok(0),
    );
    checks.same(
        "another one sees it",
        reader.status().map(|it| it.size),
        Ok(0),
    );
    cut.write_all(b"0123456789")?;
    pair.server.fail(Errno::IO);
    checks.same(
        "a failure moves nothing",
        (errno(cut.write(b"x")), cut.position()),
        (Some(Errno::IO), Ok(10)),
    );
    checks.that("formatted text is written", write!(cut, "{}", 98).is_ok());
    pair.server.lie(0);
    checks.same(
        "a host that writes nothing ends it",
        cut.write_all(b"x"),
        Err(Errno::IO.into()),
    );
    cut.seek(SeekFrom::Start(0))?;
    pair.server.lie(1000);
    checks.same("no more is written than was given", cut.write(b"01"), Ok(2));
    reader.seek(SeekFrom::Start(8))?;
    checks.same("it seeks by a step", reader.seek_relative(2), Ok(()));
    same_bytes(checks, "all was written", &mut reader, b"98x")?;
    reader.seek(SeekFrom::Start(10))?;
    let exact = reader.read_exact(&mut [0; 4]);
    checks.same(
        "there is no more",
        exact,
        Err(ReadExactError::UnexpectedEof),
    );
    cut.close()?;
    reader.close()
}

/// Reads what should follow, and no more.
pub(crate) fn same_bytes<S: Messenger + ?Sized, W: MemoryWindow, const N: usize>(
    checks: &mut Checks<'_>,
    what: &str,
    file: &mut File<'_, '_, S, W, N>,
    expected: &[u8],
) -> Result<(), Error> {
    let mut bytes = [0; 64];
    let count = file.read(&mut bytes)?;
    checks.same(what, bytes.get(..count), Some(expected));
    Ok(())
}
