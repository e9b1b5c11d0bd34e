//! Names that change while files are open.

use checks::Checks;
use condor_fs::{Errno, Error, OpenOptions};
use embedded_io::SeekFrom;

use crate::files::{System, errno, same_bytes};

/// Renames and removes.
#[inline(never)]
pub(crate) fn names(checks: &mut Checks<'_>, system: &System<'_>) -> Result<(), Error> {
    checks.group("names");
    let create = OpenOptions::new().read().write().create();
    let mut monday = system.open("log/monday", create)?;
    monday.write(b"monday")?;
    let mut tuesday = system.open("log/tuesday", create)?;
    tuesday.write(b"tuesday")?;

    checks.same(
        "a name is not taken",
        errno(system.rename_new("log/monday", "log/tuesday")),
        Some(Errno::EXIST),
    );
    checks.same(
        "what is not there has no other name",
        errno(system.rename("gone", "there")),
        Some(Errno::NOENT),
    );
    checks.same(
        "a new name is",
        system.rename_new("log/monday", "log/m"),
        Ok(()),
    );
    monday.seek(SeekFrom::Start(0))?;
    same_bytes(checks, "an open file goes on", &mut monday, b"monday")?;
    checks.same(
        "a directory is renamed",
        system.rename("log", "a longer name"),
        Ok(()),
    );
    monday.seek(SeekFrom::Start(0))?;
    same_bytes(checks, "a file in it goes on", &mut monday, b"monday")?;
    let replaced = system.rename("a longer name/m", "a longer name/tuesday");
    checks.same("a name is taken", replaced, Ok(()));
    tuesday.seek(SeekFrom::Start(0))?;
    same_bytes(
        checks,
        "what lost it stays while it is open",
        &mut tuesday,
        b"tuesday",
    )?;
    checks.same("it has no name", tuesday.status().map(|it| it.links), Ok(0));
    tuesday.close()?;
    checks.same(
        "a directory is renamed back",
        system.rename("a longer name", "log"),
        Ok(()),
    );
    monday.seek(SeekFrom::Start(0))?;
    same_bytes(checks, "a file in it goes on", &mut monday, b"monday")?;

    checks.same(
        "a directory is not unlinked",
        errno(system.unlink("log")),
        Some(Errno::ISDIR),
    );
    checks.same(
        "nor removed while there is something in it",
        errno(system.remove_directory("log")),
        Some(Errno::NOTEMPTY),
    );
    checks.same("a file is unlinked", system.unlink("log/tuesday"), Ok(()));
    checks.same(
        "once",
        errno(system.unlink("log/tuesday")),
        Some(Errno::NOENT),
    );
    monday.seek(SeekFrom::Start(0))?;
    same_bytes(checks, "it stays while it is open", &mut monday, b"monday")?;
    monday.close()?;
    system.unlink("log/a")?;
    checks.same(
        "an empty directory is removed",
        system.remove_directory("log"),
        Ok(()),
    );
    checks.same("and gone", errno(system.status("log")), Some(Errno::NOENT));
    Ok(())
}
