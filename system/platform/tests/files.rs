//! Files that are there as a whole, and files that are none.

#![cfg(all(feature = "linux", target_os = "linux"))]

use std::fs;
use std::io::{ErrorKind, Write};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

use condor_platform::linux::{WholeFile, open_regular, read_regular, read_text};

/// The variable with the directory of the test that runs with a limit.
const LIMITED: &str = "CONDOR_PLATFORM_TEST_LIMITED";

fn names(directory: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(directory).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    names.sort();
    names
}

#[test]
fn a_file_has_its_name_when_it_is_complete() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a");
    let mut file = WholeFile::create(&path).unwrap();
    file.write_all(b"first").unwrap();
    assert!(!path.exists());
    file.finish().unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"first");
    // One that is given up leaves nothing.
    let mut file = WholeFile::create(&path).unwrap();
    file.write_all(b"second").unwrap();
    drop(file);
    assert_eq!(fs::read(&path).unwrap(), b"first");
    let mut file = WholeFile::create(&path).unwrap();
    file.write_all(b"third").unwrap();
    let error = file.finish_new().unwrap_err();
    assert_eq!(error.kind(), ErrorKind::AlreadyExists);
    assert_eq!(fs::read(&path).unwrap(), b"first");
    assert_eq!(names(place.path()), [path]);
    let new = place.path().join("b");
    WholeFile::create(&new).unwrap().finish_new().unwrap();
    assert_eq!(fs::read(&new).unwrap(), b"");
    assert_eq!(names(place.path()).len(), 2);
}

#[test]
fn a_link_stays_and_so_do_the_permissions() {
    let place = tempfile::tempdir().unwrap();
    let [path, link] = ["a", "link"].map(|name| place.path().join(name));
    fs::write(&path, "former").unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o604)).unwrap();
    symlink("a", &link).unwrap();
    WholeFile::write(&link, "new").unwrap();
    assert!(link.is_symlink());
    assert_eq!(fs::read(&path).unwrap(), b"new");
    assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o604);
}

/// Runs in a child of `a_file_that_has_no_room_leaves_the_former_one`, which may write 512 bytes to a file.
#[test]
fn without_room() {
    let Some(place) = std::env::var_os(LIMITED) else {
        return;
    };
    for name in ["former", "new"] {
        let path = Path::new(&place).join(name);
        let error = WholeFile::write(path, [b'x'; 5000]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::FileTooLarge);
    }
}

#[test]
fn a_file_that_has_no_room_leaves_the_former_one() {
    let place = tempfile::tempdir().unwrap();
    let former = place.path().join("former");
    fs::write(&former, "former").unwrap();
    let limited = "trap '' XFSZ; ulimit -f 1; exec \"$0\" without_room --exact";
    let output = Command::new("sh")
        .args(["-ec", limited])
        .arg(std::env::current_exe().unwrap())
        .env(LIMITED, place.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    assert_eq!(fs::read(&former).unwrap(), b"former");
    assert_eq!(names(place.path()), [former]);
}

#[test]
fn what_is_no_regular_file_is_named_at_once() {
    let place = tempfile::tempdir().unwrap();
    let [fifo, socket, plain] = ["fifo", "socket", "plain"].map(|name| place.path().join(name));
    let made = Command::new("mkfifo").arg(&fifo).status().unwrap();
    assert!(made.success());
    let _listener = UnixListener::bind(&socket).unwrap();
    let (sender, receiver) = mpsc::channel();
    for (path, said) in [
        (&*fifo, "it is a FIFO, not a regular file"),
        (&*socket, "it is a socket, not a regular file"),
        (place.path(), "it is a directory, not a regular file"),
        (Path::new("/dev/null"), "it is a device, not a regular file"),
    ] {
        // A read that waits for ever must not take the test with it.
        let (path, sender) = (path.to_path_buf(), sender.clone());
        std::thread::spawn(move || {
            let told = [
                open_regular(&path).unwrap_err(),
                read_regular(&path).unwrap_err(),
                read_text(&path).unwrap_err(),
                WholeFile::create(&path).unwrap_err(),
            ];
            sender.send(told.map(|error| error.to_string())).unwrap();
        });
        let told = receiver.recv_timeout(Duration::from_secs(60)).unwrap();
        assert_eq!(told, [said; 4]);
    }
    fs::write(&plain, "text").unwrap();
    assert_eq!(read_text(&plain).unwrap(), "text");
    assert_eq!(read_regular(&plain).unwrap(), b"text");
    let missing = open_regular(place.path().join("missing")).unwrap_err();
    assert_eq!(missing.kind(), ErrorKind::NotFound);
}
