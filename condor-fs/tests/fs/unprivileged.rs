//! A server without privileges does what Linux lets its user do, also where it may not look itself.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::Path;

use crate::support::{CLIENT, NOBODY, Supervisor, disk, system, with_client};
use condor_fs::server::{FileServer, ServerError, ServerOptions, Step};
use condor_fs::wire::Operation;
use condor_fs::{Errno, FileError, OpenOptions};
use embedded_io::SeekFrom;

const READ: OpenOptions = OpenOptions::new().read();
const WRITE: OpenOptions = OpenOptions::new().write();

/// A directory of the server's user.
fn nobodys() -> tempfile::TempDir {
    let disk = disk();
    if crate::support::is_root() {
        chown(disk.path(), Some(NOBODY), Some(NOBODY)).unwrap();
    }
    disk
}

fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().mode() & 0o7777
}

#[test]
fn directories_that_it_cannot_read_are_made_and_removed() {
    let disk = nobodys();
    let at = |name: &str| disk.path().join(name);
    let system = system();
    let _supervisor = Supervisor::start(&system, disk.path(), None, "nobody directory-mode=555");
    with_client(&system, CLIENT, |fs, _, _, _| {
        fs.make_directory("made").unwrap();
        assert_eq!(mode(&at("made")), 0o555);
        let inside = fs.open("made/file", WRITE.exclusive());
        assert_eq!(inside.err(), Some(FileError::Errno(Errno::ACCES)));
        fs.remove_directory("made").unwrap();
        for permissions in [0, 0o333] {
            fs.make_directory("closed").unwrap();
            std::fs::set_permissions(at("closed"), PermissionsExt::from_mode(permissions)).unwrap();
            if permissions != 0 && crate::support::is_root() {
                chown(at("closed"), Some(0), Some(0)).unwrap();
            }
            fs.remove_directory("closed").unwrap();
        }
        std::fs::create_dir_all(at("full/inside")).unwrap();
        std::fs::set_permissions(at("full"), PermissionsExt::from_mode(0o311)).unwrap();
        assert_eq!(
            fs.remove_directory("full"),
            Err(FileError::Errno(Errno::NOTEMPTY))
        );
        std::fs::set_permissions(at("full"), PermissionsExt::from_mode(0o755)).unwrap();
    });
}

#[test]
fn an_open_file_of_somebody_else_is_replaced_and_stays_open() {
    let disk = nobodys();
    let at = |name: &str| disk.path().join(name);
    for name in ["theirs", "others"] {
        std::fs::write(at(name), b"theirs").unwrap(); // Root's, if this program is.
        std::fs::set_permissions(at(name), PermissionsExt::from_mode(0o644)).unwrap();
    }
    let system = system();
    let supervisor = Supervisor::start(&system, disk.path(), None, "nobody");
    with_client(&system, CLIENT, |fs, _, _, _| {
        let mut mine = fs.open("mine", WRITE.exclusive()).unwrap();
        mine.write(b"mine").unwrap();
        mine.close().unwrap();
        let mut replaced = fs.open("theirs", READ).unwrap();
        let mut removed = fs.open("others", READ).unwrap();
        fs.rename("mine", "theirs").unwrap();
        fs.unlink("others").unwrap();
        supervisor.die();
        for file in [&mut replaced, &mut removed] {
            let mut read = [0; 8];
            assert_eq!(file.read(&mut read), Ok(6));
            assert_eq!(&read[..6], b"theirs");
            assert_eq!(file.status().unwrap().links, 0);
        }
        assert_eq!(std::fs::read(at("theirs")).unwrap(), b"mine");
        assert!(!at("mine").exists() && !at("others").exists());
    });
}

#[test]
fn a_mode_that_would_keep_it_out_is_refused() {
    let disk = nobodys();
    if !crate::support::everybody_reaches(disk.path()) {
        return;
    }
    let outcome = std::thread::spawn({
        let root = disk.path().to_owned();
        move || {
            // The thread alone.
            crate::support::become_nobody();
            let with = |file_mode| {
                let options = ServerOptions {
                    file_mode,
                    ..ServerOptions::default()
                };
                FileServer::new(&root, options).map(drop)
            };
            (with(0o600), with(0o444))
        }
    });
    let (allowed, refused) = outcome.join().unwrap();
    allowed.unwrap();
    let Err(error @ ServerError::FileMode { mode: 0o444, .. }) = refused else {
        panic!("{refused:?}");
    };
    assert!(error.to_string().contains("444"), "{error}");
}

/// A file that is open stays open whatever its mode becomes, and so it does over the deaths of a server
/// that the mode keeps out.
#[test]
fn a_mode_that_keeps_it_out_does_not_close_a_file() {
    let disk = nobodys();
    let at = |name: &str| disk.path().join(name);
    let system = system();
    for kill in [
        None,
        Some((Operation::Write, Step::Widened, 1)),
        Some((Operation::Write, Step::Begun, 1)),
    ] {
        let first = Supervisor::start(&system, disk.path(), None, "nobody");
        with_client(&system, CLIENT, |fs, _, _, _| {
            let new = WRITE.read().exclusive().mode(0o640);
            let (mut file, mut gone) = (fs.open("f", new).unwrap(), fs.open("g", new).unwrap());
            for file in [&mut file, &mut gone] {
                file.write(b"1").unwrap();
                file.set_mode(0o1040).unwrap();
            }
            fs.unlink("g").unwrap();
            drop(first);
            // The next one dies where it has opened the mode, and the one after that.
            let second = Supervisor::start(&system, disk.path(), kill, "nobody");
            for file in [&mut file, &mut gone] {
                file.write(b"23").unwrap();
                second.die();
                assert_eq!(file.status().unwrap().mode, 0o101_040, "{kill:?}");
                let mut read = [0; 4];
                file.seek(SeekFrom::Start(0)).unwrap();
                assert_eq!(file.read(&mut read), Ok(3));
                assert_eq!(&read[..3], b"123");
            }
            assert_eq!(mode(&at("f")), 0o1040);
            let deaths = second.deaths();
            assert_eq!(deaths, if kill.is_some() { 3 } else { 2 }, "{kill:?}");
            if !crate::support::is_root() || crate::support::everybody_reaches(disk.path()) {
                let again = fs.open("f", READ);
                assert_eq!(
                    again.err(),
                    Some(FileError::Errno(Errno::ACCES)),
                    "not for others"
                );
            }
            fs.unlink("f").unwrap();
        });
    }
}

/// What a request is given up for has its mode back.
#[test]
fn a_request_that_is_given_up_leaves_the_mode() {
    let disk = nobodys();
    let system = system();
    let first = Supervisor::start(&system, disk.path(), None, "nobody");
    with_client(&system, CLIENT, |fs, _, _, _| {
        let mut file = fs.open("f", WRITE.exclusive()).unwrap();
        file.set_mode(0).unwrap();
        drop(first);
        // Dies at it again and again: the first incarnation after it opened the mode.
        let kill = Some((Operation::Write, Step::Widened, 1));
        let _second = Supervisor::start(&system, disk.path(), kill, "nobody every-incarnation");
        let given_up = file.write(b"1");
        assert_eq!(given_up, Err(FileError::Errno(Errno::CANCELED)));
        assert_eq!(mode(&disk.path().join("f")), 0);
    });
}

/// What was made is open for who made it, also if a next incarnation finishes it that may not open it.
#[test]
fn a_file_that_it_may_not_open_is_made_once() {
    for (options, step) in [
        (WRITE.exclusive(), Step::Moved),
        (WRITE.exclusive(), Step::Acted),
        (WRITE.create(), Step::Staged),
        (WRITE.create(), Step::Acted),
    ] {
        let disk = nobodys();
        let system = system();
        let kill = Some((Operation::Open, step, 1));
        let supervisor = Supervisor::start(&system, disk.path(), kill, "nobody");
        with_client(&system, CLIENT, |fs, _, _, _| {
            let mut file = fs.open("f", options.mode(0o400)).unwrap();
            file.write(b"made").unwrap();
            assert_eq!(file.status().unwrap().mode, 0o100_400);
            file.close().unwrap();
        });
        assert_eq!(supervisor.deaths(), 1);
        let path = disk.path().join("f");
        assert_eq!(
            (mode(&path), std::fs::read(&path).unwrap()),
            (0o400, b"made".to_vec())
        );
    }
}

/// Who opens a file that a program of the host has a lease of waits until that is given up.
#[test]
fn a_lease_of_the_host_is_waited_for() {
    use std::os::fd::AsRawFd;
    let disk = disk();
    let path = disk.path().join("leased");
    std::fs::write(&path, b"old").unwrap();
    let file = std::fs::File::open(&path).unwrap();
    let lease = |kind: libc::c_int| {
        // SAFETY: it takes numbers alone.
        let outcome = unsafe { libc::fcntl(file.as_raw_fd(), libc::F_SETLEASE, kind) };
        assert_eq!(outcome, 0, "{}", std::io::Error::last_os_error());
    };
    // SAFETY: no handler is installed.
    unsafe { libc::signal(libc::SIGIO, libc::SIG_IGN) };
    crate::support::with_server(disk.path(), "", |fs, _, _, _| {
        lease(libc::F_RDLCK);
        std::thread::scope(|threads| {
            threads.spawn(|| {
                // SAFETY: as above.
                while unsafe { libc::fcntl(file.as_raw_fd(), libc::F_GETLEASE) } == libc::F_RDLCK {
                    std::thread::yield_now(); // Until the server wants to open it.
                }
                lease(libc::F_UNLCK);
            });
            let mut opened = fs.open("leased", WRITE.truncate()).unwrap();
            opened.write(b"new").unwrap();
        });
    });
    assert_eq!(std::fs::read(&path).unwrap(), b"new");
}
