//! Directories and their entries.

use checks::Checks;
use condor_fs::{Entry, Errno, Error, OpenOptions};

use crate::files::{System, errno};

/// Makes some, and reads them.
#[inline(never)]
pub(crate) fn directories(checks: &mut Checks<'_>, system: &System<'_>) -> Result<(), Error> {
    checks.group("directories");
    checks.same("one is made", system.make_directory("log"), Ok(()));
    checks.same(
        "not twice",
        errno(system.make_directory("log")),
        Some(Errno::EXIST),
    );
    checks.same(
        "not in a file",
        errno(system.make_directory("run/log")),
        Some(Errno::NOTDIR),
    );
    let kinds = |path: &str| {
        system
            .status(path)
            .map(|it| (it.is_directory(), it.is_file()))
    };
    checks.same("it is one", kinds("log"), Ok((true, false)));
    checks.same("a file is none", kinds("run"), Ok((false, true)));
    checks.same(
        "it is no file",
        errno(system.open("log", OpenOptions::new().read())),
        Some(Errno::ISDIR),
    );
    checks.same(
        "a file is not listed",
        errno(system.open_directory("run")),
        Some(Errno::NOTDIR),
    );
    let create = OpenOptions::new().write().create();
    for path in ["log/a", "log/monday", "log/tuesday"] {
        system.open(path, create)?.close()?;
    }

    let mut log = system.open_directory("log")?;
    let mut name = [0; 16];
    // More than one buffer holds.
    for expected in ["a", "monday", "tuesday"] {
        let entry = log.next(&mut name)?;
        let file = Entry {
            name: expected.as_bytes(),
            kind: 8,
        };
        checks.same("a file is in it", entry, Some(file));
    }
    checks.same("and no more", log.next(&mut name), Ok(None));
    checks.same("it is closed", log.close(), Ok(()));

    let mut tree = system.open_directory(".")?;
    let mut kinds = [0; 3];
    for kind in &mut kinds {
        if let Some(entry) = tree.next(&mut name)? {
            *kind = u32::from(entry.is_directory()) << 1 | u32::from(entry.is_file());
        }
    }
    checks.same(
        "the tree has a link, a file and a directory",
        kinds,
        [0, 1, 2],
    );
    drop(tree);
    let mut log = system.open_directory("log")?;
    let mut short = [0; 4];
    checks.that(
        "a short name fits",
        matches!(log.next(&mut short), Ok(Some(entry)) if entry.name == b"a"),
    );
    checks.same(
        "a longer one does not",
        log.next(&mut short),
        Err(Errno::NAMETOOLONG.into()),
    );
    let passed = log
        .next(&mut name)?
        .is_some_and(|entry| entry.name == b"tuesday");
    checks.that("and is passed over", passed);
    Ok(())
}
