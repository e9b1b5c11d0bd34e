//! The quota counts all that is in the tree, whatever it takes, and what clients make and remove.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use crate::support::{disk, with_server};
use condor_fs::server::{FileServer, ServerOptions};
use condor_fs::{Errno, FileError, OpenOptions};
use embedded_io::SeekFrom;

const WRITE: OpenOptions = OpenOptions::new().write();

#[track_caller]
fn fails<T>(outcome: Result<T, FileError>, errno: Errno) {
    assert_eq!(outcome.err(), Some(FileError::Errno(errno)));
}

#[test]
fn all_bytes_are_counted_with_few_descriptors() {
    let disk = disk();
    // Many directories beside each other, and many in each other.
    for n in 0..600 {
        let directory = disk.path().join(format!("{n}"));
        std::fs::create_dir(&directory).unwrap();
        std::fs::write(directory.join("file"), [0; 10]).unwrap();
    }
    let mut deep = disk.path().to_owned();
    for _ in 0..300 {
        deep.push("d");
        std::fs::create_dir(&deep).unwrap();
    }
    std::fs::write(deep.join("file"), [0; 10]).unwrap();
    // Two names, one file.
    std::fs::hard_link(deep.join("file"), deep.join("again")).unwrap();
    // 1502 names of 1024 bytes, 601 files of 10, and one more of 91.
    with_server(
        disk.path(),
        "quota=1545171 descriptors=64",
        |fs, _, _, _| {
            let mut file = fs.open("new", WRITE.create()).unwrap();
            fails(file.write(&[1; 90]), Errno::DQUOT);
            assert_eq!(file.write(&[1; 89]), Ok(89));
            fails(file.write(&[1; 1]), Errno::DQUOT);
        },
    );
}

#[test]
fn names_count_and_are_given_back() {
    let disk = disk();
    with_server(disk.path(), "quota=4096", |fs, _, _, _| {
        let make = |name: &str| fs.open(name, WRITE.create())?.close();
        fs.make_directory("d").unwrap();
        for name in ["a", "b"] {
            make(name).unwrap();
        }
        make("a").unwrap(); // It exists.
        fs.open("c", WRITE.exclusive()).unwrap().close().unwrap();
        fails(fs.make_directory("e"), Errno::DQUOT);
        fails(make("e"), Errno::DQUOT);
        fails(fs.open("e", WRITE.exclusive()), Errno::DQUOT);
        // Every way to make room, and to find that it is no more.
        fs.remove_directory("d").unwrap();
        make("d").unwrap();
        fails(make("e"), Errno::DQUOT);
        fs.rename("c", "d").unwrap();
        make("c").unwrap();
        fails(make("e"), Errno::DQUOT);
        fs.unlink("c").unwrap();
        let mut open = fs.open("a", WRITE).unwrap();
        assert_eq!(open.write(&[1; 1000]), Ok(1000));
        fails(make("e"), Errno::DQUOT);
        fs.unlink("a").unwrap();
        fails(make("e"), Errno::DQUOT); // What is open stays.
        open.truncate(0).unwrap();
        make("e").unwrap();
        fails(make("f"), Errno::DQUOT);
        open.close().unwrap();
        make("f").unwrap();
        fs.unlink("e").unwrap();
        let mut file = fs.open("f", WRITE).unwrap();
        assert_eq!(file.write(&[1; 1024]), Ok(1024));
        file.seek(SeekFrom::Start(0)).unwrap();
        fails(make("e"), Errno::DQUOT);
        fs.open("f", WRITE.truncate()).unwrap().close().unwrap();
        make("e").unwrap();
        fails(make("g"), Errno::DQUOT);
    });
}

#[test]
fn what_cannot_be_counted_is_named() {
    if !crate::support::is_root() {
        return; // It takes two users.
    }
    let disk = disk();
    if !crate::support::everybody_reaches(disk.path()) {
        return;
    }
    std::fs::create_dir_all(disk.path().join("d/closed")).unwrap();
    std::fs::set_permissions(
        disk.path().join("d/closed"),
        PermissionsExt::from_mode(0o700),
    )
    .unwrap();
    std::os::unix::fs::chown(disk.path(), Some(crate::support::NOBODY), None).unwrap();
    let start = |root: &Path| {
        let options = ServerOptions {
            quota_bytes: Some(1 << 20),
            ..ServerOptions::default()
        };
        FileServer::new(root, options).map(drop)
    };
    start(disk.path()).unwrap();
    std::fs::remove_dir_all(disk.path().join(".condor-fs")).unwrap();
    let root = disk.path().to_owned();
    let refused = std::thread::spawn(move || {
        crate::support::become_nobody();
        start(&root)
    });
    let error = refused.join().unwrap().unwrap_err().to_string();
    assert!(
        error.contains("d/closed") && error.contains("Permission denied"),
        "{error}"
    );
}
