//! Buffers that are lent, and operations whose end is not known.

use checks::Checks;
use condor_fs::{Buffer, Errno, Error, Kept, OpenOptions};
use condor_mbox::{MemoryWindow as _, Places};
use embedded_io::SeekFrom;

use crate::files::{System, errno};
use crate::pair::{PATIENCE, Pair, SHORT, Window};

const TEXT: &[u8] = b"0123456789abcdef";

/// Lends buffers to a host that answers, and to one that does not.
#[inline(never)]
pub(crate) fn doubt(
    checks: &mut Checks<'_>,
    pair: &Pair<'_>,
    system: &System<'_>,
    places: &mut Places,
) -> Result<(), Error> {
    checks.group("buffers");
    let buffer = Buffer::new(&pair.own, places, 32)?;
    let spare = Buffer::new(&pair.own, places, 32)?;
    checks.that(
        "there is an end of room",
        Buffer::new(&pair.own, places, 4096).is_err(),
    );
    let mut file = system.open("data", OpenOptions::new().read().write().create())?;
    buffer.memory().write(0, TEXT)?;
    let (count, buffer) = file.write_buffer(buffer, 16).map_err(|kept| kept.error)?;
    checks.same("it is written", (count, file.position()), (16, Ok(16)));
    buffer.memory().write(0, &[0; 16])?;
    file.seek(SeekFrom::Start(10))?;
    let (count, buffer) = file.read_buffer(buffer, 32).map_err(|kept| kept.error)?;
    checks.that("it is read", count == 6 && begins(&buffer, b"abcdef"));
    let (failed, buffer) = refused(file.read_buffer(buffer, 33));
    checks.same("no more than it has", failed, Some(Errno::FAULT));
    let buffer = buffer.unwrap_or(spare);
    pair.server.fail(Errno::IO);
    let (failed, returned) = refused(file.write_buffer(buffer, 4));
    checks.that(
        "a failure gives it back",
        failed == Some(Errno::IO) && returned.is_some(),
    );
    let Some(buffer) = returned else {
        return Ok(());
    };

    checks.group("doubt");
    system.set_timeout(SHORT);
    checks.same("nothing is to be settled", system.settle(SHORT), Ok(None));
    checks.that("no buffer is kept", system.take_buffer().is_none());
    pair.attentive.set(false);
    file.seek(SeekFrom::Start(2))?;
    buffer.memory().write(0, b"ABCD")?;
    let late = file.write_buffer(buffer, 4);
    let kept = matches!(
        &late,
        Err(Kept {
            error: Error::TimedOut { .. },
            buffer: None
        })
    );
    checks.that("a late answer keeps the buffer", kept);
    checks.that("it is in doubt", system.in_doubt());
    checks.that("the buffer is not given", system.take_buffer().is_none());
    let settled = system.settle(SHORT);
    checks.that(
        "it remains so",
        matches!(settled, Err(Error::TimedOut { .. })),
    );
    let waits = matches!(system.status("data"), Err(Error::NotBegun { .. }));
    checks.that("nothing else is done before", waits);
    pair.attentive.set(true);
    checks.same("it is settled", system.settle(PATIENCE), Ok(Some(Ok(4))));
    checks.same("the position has moved", file.position(), Ok(6));
    system.set_timeout(PATIENCE);
    let buffer = Buffer::new(&pair.own, places, 32)?;
    let (busy, buffer) = refused(file.read_buffer(buffer, 4));
    checks.same("the buffer is to be taken first", busy, Some(Errno::BUSY));
    checks.that(
        "it is",
        system
            .take_buffer()
            .is_some_and(|kept| begins(&kept, b"ABCD")),
    );
    let Some(buffer) = buffer else {
        return Ok(());
    };
    file.seek(SeekFrom::Start(0))?;
    let (count, buffer) = file.read_buffer(buffer, 8).map_err(|kept| kept.error)?;
    checks.that(
        "it was done once",
        count == 8 && begins(&buffer, b"01ABCD67"),
    );

    system.set_timeout(SHORT);
    pair.attentive.set(false);
    let unlinked = system.unlink("nothing");
    checks.that(
        "another one is late",
        matches!(unlinked, Err(Error::TimedOut { .. })),
    );
    pair.attentive.set(true);
    let settled = system.settle(PATIENCE);
    checks.same("it has failed", settled, Ok(Some(Err(Errno::NOENT))));
    system.set_timeout(PATIENCE);
    checks.same("the next one goes well", file.close(), Ok(()));
    checks.same("and the one after it", errno(system.unlink("data")), None);
    Ok(())
}

fn begins(buffer: &Buffer<Window>, expected: &[u8]) -> bool {
    let mut bytes = [0; 16];
    bytes
        .get_mut(..expected.len())
        .is_some_and(|bytes| buffer.memory().read(0, bytes).is_ok() && bytes == expected)
}

/// Why a buffer was not read or written, and the buffer, either way.
fn refused(lent: condor_fs::Lent<Window>) -> (Option<Errno>, Option<Buffer<Window>>) {
    match lent {
        Ok((_, buffer)) => (None, Some(buffer)),
        Err(Kept { error, buffer }) => (error.errno(), buffer),
    }
}
