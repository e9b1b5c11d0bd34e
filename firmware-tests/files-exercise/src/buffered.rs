//! Readers and writers that make few calls of many.

use core::fmt::Write as _;
use core::sync::atomic::Ordering::Relaxed;

use checks::Checks;
use condor_fs::{Errno, Error, FileReader, FileWriter, OpenOptions, Unwritten};
use embedded_io::{BufRead as _, Read as _, ReadExactError, Seek as _, SeekFrom, Write as _};

use crate::files::System;
use crate::pair::{BUFFER_BYTES, FILES, Mail, PATIENCE, Pair, SHORT, Window};
use crate::text::Text;

type Writer<'f, 'p> = FileWriter<'f, 'p, Mail<'p>, Window, FILES>;
/// Eight bytes of it are in the reader.
type Reader<'f, 'p> = FileReader<'f, 'p, Mail<'p>, Window, FILES, 8>;

/// Writes a file and reads it again.
#[inline(never)]
pub(crate) fn buffered<'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
    system: &System<'p>,
) -> Result<(), Error> {
    let options = OpenOptions::new().read().write().create();
    let writer = system.open("hand", options)?.writer();
    let Some(writer) = writing(checks, pair, writer) else {
        return Ok(());
    };
    late_write(checks, pair, system, writer)?;
    let reader = system.open("hand", options)?.reader();
    let reader = reading(checks, pair, reader)?;
    late_read(checks, pair, system, reader);
    system.unlink("hand")
}

fn writing<'f, 'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
    mut writer: Writer<'f, 'p>,
) -> Option<Writer<'f, 'p>> {
    checks.group("a buffered writer");
    let requests = || pair.server.requests.load(Relaxed);
    let before = requests();
    for joint in 0..4 {
        let written = writeln!(writer, "joint {joint}");
        checks.that("formatted text is taken", written.is_ok());
    }
    checks.same("it is held", (writer.held(), requests()), (32, before));
    checks.same("all is taken", writer.write_all(&[b'-'; 40]), Ok(()));
    let asked = requests().wrapping_sub(before);
    checks.same("a full buffer is written", (writer.held(), asked), (8, 1));
    checks.same(
        "a seek writes the rest",
        writer.seek(SeekFrom::Start(0)),
        Ok(0),
    );
    checks.same("nothing is held", writer.held(), 0);
    checks.same("some is taken", writer.write(b"JOINT"), Ok(5));
    pair.server.fail(Errno::NOSPC);
    let refused = writer.flush();
    checks.same("a failure is told", refused, Err(Errno::NOSPC.into()));
    pair.server.fail(Errno::NOSPC);
    let Err(unwritten) = writer.into_inner() else {
        checks.that("the file is not given up before", false);
        return None;
    };
    let mut text = Text::<80>::new();
    // It takes everything.
    let _ = write!(text, "{unwritten}; {unwritten:?}");
    checks.same(
        "for people and programmers",
        text.bytes(),
        b"No space left (ENOSPC); Unwritten { error: Errno(ENOSPC), writer: Some(..) }",
    );
    let Unwritten { error, writer } = unwritten;
    checks.same("why", error, Errno::NOSPC.into());
    checks.that("the writer comes back", writer.is_some());
    writer
}

fn late_write<'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
    system: &System<'p>,
    mut writer: Writer<'_, 'p>,
) -> Result<(), Error> {
    system.set_timeout(SHORT);
    pair.attentive.set(false);
    let late = writer.flush();
    checks.that(
        "a host is late",
        matches!(late, Err(Error::TimedOut { .. })),
    );
    let late = writer.write(b"!");
    checks.that(
        "nothing is taken",
        matches!(late, Err(Error::NotBegun { .. })),
    );
    checks.same("and nothing lost", writer.held(), 5);
    pair.attentive.set(true);
    system.set_timeout(PATIENCE);
    checks.same("it is written", writer.flush(), Ok(()));
    let Ok(file) = writer.into_inner() else {
        checks.that("the file comes back", false);
        return Ok(());
    };
    checks.same("once", file.position(), Ok(5));
    checks.same("in its place", file.status().map(|it| it.size), Ok(72));
    pair.server.fail(Errno::IO);
    let Err(unwritten) = file.writer().close() else {
        checks.that("a failure to close is told", false);
        return Ok(());
    };
    checks.that(
        "a failure to close is none to write",
        unwritten.error == Errno::IO.into() && unwritten.writer.is_none(),
    );
    let again = system.open("hand", OpenOptions::new().append())?.writer();
    checks.that("another one is closed", again.close().is_ok());
    Ok(())
}

fn reading<'f, 'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
    mut reader: Reader<'f, 'p>,
) -> Result<Reader<'f, 'p>, Error> {
    checks.group("a buffered reader");
    let requests = || pair.server.requests.load(Relaxed);
    let before = requests();
    checks.same("it holds some", reader.fill_buf(), Ok(&b"JOINT 0\n"[..]));
    reader.consume(6);
    checks.same("the rest of it is left", reader.fill_buf(), Ok(&b"0\n"[..]));
    checks.same("its position is the reader's", reader.position(), Ok(6));
    let mut bytes = [0; 10];
    let exact = reader.read_exact(&mut bytes);
    checks.same(
        "as much as is asked for is read",
        (exact, &bytes),
        (Ok(()), b"0\njoint 1\n"),
    );
    checks.same("it knows where it is", reader.stream_position(), Ok(16));
    let mut bytes = [0; BUFFER_BYTES as usize];
    checks.same("all that is left is read", reader.read(&mut bytes), Ok(48));
    checks.same("at one request", requests().wrapping_sub(before), 1);
    checks.same("it goes back", reader.seek(SeekFrom::Current(-56)), Ok(8));
    let mut file = reader.into_inner()?;
    checks.same(
        "so does the file",
        (file.position(), file.read(&mut bytes)),
        (Ok(8), Ok(64)),
    );
    checks.same(
        "which is at its end",
        bytes.get(56..64),
        Some(&[b'-'; 8][..]),
    );
    let mut reader = file.reader();
    checks.same("at the end is nothing", reader.fill_buf(), Ok(&b""[..]));
    let exact = reader.read_exact(&mut bytes);
    checks.same("no more is read", exact, Err(ReadExactError::UnexpectedEof));
    Ok(reader)
}

fn late_read<'p>(
    checks: &mut Checks<'_>,
    pair: &Pair<'p>,
    system: &System<'p>,
    mut reader: Reader<'_, 'p>,
) {
    checks.same("it rewinds", reader.rewind(), Ok(()));
    system.set_timeout(SHORT);
    pair.attentive.set(false);
    let mut word = [0; 5];
    let late = reader.read(&mut word);
    checks.that(
        "a host is late",
        matches!(late, Err(Error::TimedOut { .. })),
    );
    pair.attentive.set(true);
    system.set_timeout(PATIENCE);
    checks.same("what it has read comes next", reader.read(&mut word), Ok(5));
    checks.same(
        "from where it was",
        (&word, reader.position()),
        (b"JOINT", Ok(5)),
    );
}
