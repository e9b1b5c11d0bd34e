//! Requests of which the server dies, each time that it works on them: they are given up, and others are
//! served.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::time::Duration;

use crate::support::{CLIENT, Fs, N, OTHER, Supervisor, disk, system, with_client};
use condor_fs::server::Step;
use condor_fs::wire::Operation;
use condor_fs::{Errno, FileError, OpenOptions};
use condor_mbox::linux::LinuxSystem;
use embedded_io::SeekFrom;

const WRITE: OpenOptions = OpenOptions::new().write();

#[test]
fn the_limit_of_the_process_is_an_error_of_the_request() {
    let root = disk();
    let system = system();
    let supervisor = Supervisor::start(&system, root.path(), None, "file-limit=1000");
    with_client(&system, CLIENT, |fs, _, _, _| {
        let large = |outcome: Result<usize, FileError>| {
            assert_eq!(outcome, Err(FileError::Errno(Errno::FBIG)));
        };
        let mut file = fs.open("f", WRITE.create().exclusive()).unwrap();
        assert_eq!(file.write(&[1; 1000]), Ok(1000));
        large(file.write(b"1"));
        large(file.truncate(1001).map(|()| 0));
        file.seek(SeekFrom::Start(999)).unwrap();
        large(file.write(b"12"));
        let mut log = fs.open("f", OpenOptions::new().append()).unwrap();
        large(log.write(b"1"));
        // A file that is longer already, by somebody without a limit.
        std::fs::write(root.path().join("long"), [2; 3000]).unwrap();
        let mut longer = fs.open("long", WRITE).unwrap();
        longer.seek(SeekFrom::Start(1500)).unwrap();
        large(longer.write(b"1"));
        longer.truncate(2000).unwrap();
    });
    assert_eq!(supervisor.deaths(), 0);
    let found = std::fs::read(root.path().join("f")).unwrap();
    assert_eq!(found, [1; 1000]);
}

/// What comes of an operation that kills the first server at `step`, and then each that takes it; another
/// processor is served.
fn given_up<R>(
    root: &std::path::Path,
    operation: Operation,
    step: Step,
    act: impl FnOnce(&Fs<'_, '_>) -> Result<R, FileError>,
) -> Result<R, FileError> {
    let system = system();
    let kill = Some((operation, step, 1));
    let supervisor = Supervisor::start(&system, root, kill, "every-incarnation");
    let outcome = with_client(&system, CLIENT, |fs, _, _, _| act(fs));
    assert_eq!(supervisor.deaths(), 2, "{operation:?} {step:?}");
    with_client(&system, OTHER, |fs, _, _, _| {
        let nothing = fs.status("nothing").unwrap_err();
        assert_eq!(nothing.errno(), Some(Errno::NOENT));
    });
    assert_eq!(supervisor.deaths(), 2, "{operation:?} {step:?}");
    outcome
}

#[test]
fn no_request_is_worked_on_by_a_third_server() {
    let canceled = Err(FileError::Errno(Errno::CANCELED));
    let left = |root: &std::path::Path| std::fs::read_dir(root.join(".condor-fs")).unwrap().count();
    let root = disk();
    let root = root.path();
    let at = |path: &str| root.join(path);
    let renew = || {
        for path in ["d", "new"] {
            let _ = std::fs::remove_dir(at(path));
        }
        let _ = std::fs::remove_file(at("g"));
        std::fs::write(at("f"), b"....").unwrap();
    };
    renew();
    std::fs::create_dir(at("d")).unwrap();

    // What is harmless to repeat, and what may be there in part.
    let read = OpenOptions::new().read();
    for (operation, step) in [
        (Operation::Read, Step::Taken),
        (Operation::Read, Step::Part),
        (Operation::FileStatus, Step::Acted),
        (Operation::Sync, Step::Acted),
        (Operation::Write, Step::Begun),
        (Operation::Truncate, Step::Acted),
        (Operation::Append, Step::Begun),
        (Operation::Append, Step::Staged),
        (Operation::Close, Step::Acted),
    ] {
        let outcome = given_up(root, operation, step, |fs| match operation {
            Operation::Read => fs.open("f", read)?.read(&mut [0; 8]).map(drop),
            Operation::FileStatus => fs.open("f", read)?.status().map(drop),
            Operation::Sync => fs.open("f", WRITE)?.sync(),
            Operation::Write => fs.open("f", WRITE)?.write(b"....").map(drop),
            Operation::Truncate => fs.open("f", WRITE)?.truncate(4),
            Operation::Close => fs.open("f", WRITE)?.close(),
            _ => {
                let append = OpenOptions::new().append();
                fs.open("f", append)?.write(b"lost").map(drop)
            }
        });
        assert_eq!(outcome, canceled, "{operation:?} {step:?}");
        assert_eq!(std::fs::read(at("f")).unwrap(), b"....");
    }
    // All that was appended is there.
    let outcome = given_up(root, Operation::Append, Step::Part, |fs| {
        fs.open("f", OpenOptions::new().append())?.write(b"more")
    });
    assert_eq!(outcome, Ok(4));
    assert_eq!(std::fs::read(at("f")).unwrap(), b"....more");

    // The answer says whether it has happened.
    for (operation, step, happens) in [
        (Operation::Rename, Step::Staged, false),
        (Operation::Rename, Step::Moved, true),
        (Operation::Unlink, Step::Staged, false),
        (Operation::Unlink, Step::Acted, true),
        (Operation::RemoveDirectory, Step::Staged, false),
        (Operation::RemoveDirectory, Step::Acted, true),
        (Operation::MakeDirectory, Step::Staged, false),
        (Operation::MakeDirectory, Step::Made, true),
        (Operation::MakeDirectory, Step::Acted, true),
        (Operation::Open, Step::Staged, false),
        (Operation::Open, Step::Moved, true),
    ] {
        renew();
        let _ = std::fs::create_dir(at("d"));
        let outcome = given_up(root, operation, step, |fs| match operation {
            Operation::Rename => fs.rename("f", "g"),
            Operation::Unlink => fs.unlink("f"),
            Operation::RemoveDirectory => fs.remove_directory("d"),
            Operation::MakeDirectory => fs.make_directory("new"),
            _ => fs.open("g", WRITE.exclusive()).map(drop),
        });
        let what = format!("{operation:?} {step:?}");
        assert_eq!(left(root), 2, "{what}: the lock and the journal");
        let expected = if happens { Ok(()) } else { canceled };
        assert_eq!(outcome, expected, "{what}");
        let there = |path: &str, expected: bool| assert_eq!(at(path).exists(), expected, "{what}");
        match operation {
            Operation::Rename => {
                there("f", !happens);
                there("g", happens);
            }
            Operation::Unlink => there("f", !happens),
            Operation::RemoveDirectory => there("d", !happens),
            Operation::MakeDirectory => there("new", happens),
            _ => there("g", happens),
        }
    }
}

/// A file that was unlinked or replaced while it was open goes on, though the server died twice at that.
#[test]
fn an_open_file_outlives_an_unlink_that_was_given_up() {
    let root = disk();
    std::fs::write(root.path().join("f"), b"data").unwrap();
    let read = given_up(root.path(), Operation::Unlink, Step::Acted, |fs| {
        let mut file = fs.open("f", OpenOptions::new().read())?;
        fs.unlink("f")?;
        let mut bytes = [0; 8];
        let read = file.read(&mut bytes)?;
        Ok(bytes[..read].to_vec())
    });
    assert_eq!(read, Ok(b"data".to_vec()));
    for (step, replaced) in [
        (Step::Staged, false),
        (Step::Moved, true),
        (Step::Aside, true),
        (Step::Marked, true),
        (Step::Acted, true),
    ] {
        std::fs::write(root.path().join("f"), b"data").unwrap();
        std::fs::write(root.path().join("g"), b"new").unwrap();
        let read = given_up(root.path(), Operation::Rename, step, |fs| {
            let mut file = fs.open("f", OpenOptions::new().read())?;
            let renamed = fs.rename("g", "f");
            assert_eq!(renamed.is_ok(), replaced, "{step:?}");
            let mut bytes = [0; 8];
            let read = file.read(&mut bytes)?;
            file.close()?;
            Ok(bytes[..read].to_vec())
        });
        assert_eq!(read, Ok(b"data".to_vec()), "{step:?}");
        let own = std::fs::read_dir(root.path().join(".condor-fs")).unwrap();
        assert_eq!(own.count(), 2, "{step:?}: the lock and the journal");
    }
}

/// A client that does not answer is asked as often as it likes: nothing is begun, and nothing given up.
#[test]
fn a_request_that_could_not_be_begun_is_not_given_up() {
    let root = disk();
    std::fs::write(root.path().join("f"), b"data").unwrap();
    let system: std::sync::Arc<LinuxSystem<N>> = system();
    let _supervisor = Supervisor::start(&system, root.path(), None, "");
    crate::support::with_silent_client(&system, CLIENT, |fs| {
        fs.set_timeout(Duration::from_millis(50));
        let late = fs.unlink("f").unwrap_err();
        assert!(matches!(late, FileError::TimedOut { .. }), "{late}");
        // The client asks again every millisecond.
        let settled = fs.settle(Duration::from_millis(50));
        assert!(
            matches!(settled, Err(FileError::TimedOut { .. })),
            "{settled:?}"
        );
    });
    assert!(root.path().join("f").exists());
}
