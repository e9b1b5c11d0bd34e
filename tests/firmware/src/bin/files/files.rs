//! Files of the host, over the processor's mailbox.

use condor_dev::stdio::{BufReader, BufWriter, Buffering};
use condor_fs::{Errno, File, FileError, FileSystem, OpenOptions};
use embedded_io::{SeekFrom, Write as _};
use firmware::Checks;

use crate::ends::{Ends, FILES, ends};
use crate::host::{self, CONTENT};
use crate::{HOST, Mail, PATIENCE, Told, Window};

/// The files of the processor.
pub(crate) type System = FileSystem<'static, Mail, Window, FILES>;

/// Gets a session.
pub(crate) fn connect(checks: &mut Checks) -> Result<(&'static Ends, System), Told> {
    checks.group("files");
    let ends = ends()?.ok_or(Errno::AGAIN)?;
    let system = FileSystem::connect(&ends.hand, HOST, ends.own, ends.area, PATIENCE)?;
    Ok((ends, system))
}

/// Opens, writes and reads a file; a call fails.
#[inline(never)]
pub(crate) fn files(checks: &mut Checks, system: &System) -> Result<(), FileError> {
    let options = OpenOptions::new().read().write();
    host::fail(Errno::NOENT);
    let none = system.open("run", options).err();
    checks.same(none, Some(Errno::NOENT.into()));
    let mut run = system.open("run", options.create().truncate())?;
    checks.same(run.write(&[b'-'; 70]), Ok(64));
    checks.same(run.position(), Ok(64));
    let size = run.status().map(|status| status.size);
    checks.same(size, Ok(CONTENT.len() as u64));
    checks.same(File::seek(&mut run, SeekFrom::Start(7)), Ok(7));
    let mut part = [0; 4];
    checks.same((run.read(&mut part), &part), (Ok(4), b"3 is"));
    host::fail(Errno::NOSPC);
    checks.same(run.write(b"!"), Err(Errno::NOSPC.into()));
    let mut bytes = [0; 6];
    let read = run.begin_read_at(&mut bytes, 0).wait(PATIENCE);
    checks.same((read, &bytes), (Ok(6), b"tendon"));
    File::seek(&mut run, SeekFrom::Start(0))?;
    let lines = BufReader::<_, 16>::new(run);
    let mut both = BufWriter::<_, 16>::new(lines, Buffering::Line);
    let mut line = [0; 16];
    let long = both.inner_mut().read_line(|byte| byte == b'\n', &mut line);
    checks.same(long.ok(), None);
    let end = both.inner_mut().read_line(|byte| byte == b'\n', &mut line);
    checks.same(end.ok(), Some(""));
    checks.same(both.write(b"slack"), Ok(5));
    checks.same(both.held(), b"slack");
    checks.that(both.write(b" again\n").is_ok() && both.held().is_empty());
    both.into_inner().into_inner().close()
}
