//! No path or link leads a client out of the tree, whatever changes meanwhile.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::support::{Fs, disk, snapshot, with_server};
use condor_fs::{Errno, FileError, OpenOptions};

const READ: OpenOptions = OpenOptions::new().read();
const WRITE: OpenOptions = OpenOptions::new().write();

/// A tree, and beside it what nobody may touch.
fn with_outside(program: impl FnOnce(&Fs<'_, '_>, &Path, &Path)) {
    let disk = disk();
    let (tree, outside) = (disk.path().join("tree"), disk.path().join("outside"));
    std::fs::create_dir_all(tree.join("inside")).unwrap();
    std::fs::create_dir_all(outside.join("directory")).unwrap();
    std::fs::write(outside.join("secret"), b"secret").unwrap();
    std::fs::write(tree.join("inside/file"), b"inside").unwrap();
    let before = snapshot(&outside);
    with_server(&tree, "", |fs, _, _, _| program(fs, &tree, &outside));
    assert_eq!(snapshot(&outside), before);
}

/// Tries everything with a path that must not lead anywhere; gives the answers.
fn everything(fs: &Fs<'_, '_>, path: &str) -> Vec<Errno> {
    let mut answers = Vec::new();
    let mut refused = |what: &str, outcome: Result<(), FileError>| match outcome {
        Err(FileError::Errno(errno)) => answers.push(errno),
        other => panic!("{what} of {path:?}: {other:?}"),
    };
    refused("read", fs.open(path, READ).map(drop));
    refused("write", fs.open(path, WRITE).map(drop));
    refused("create", fs.open(path, WRITE.create()).map(drop));
    refused(
        "truncate",
        fs.open(path, WRITE.truncate().create()).map(drop),
    );
    refused("exclusive", fs.open(path, WRITE.exclusive()).map(drop));
    refused("directory", fs.open_directory(path).map(drop));
    refused("status", fs.status(path).map(drop));
    refused("mkdir", fs.make_directory(path));
    refused("rmdir", fs.remove_directory(path));
    refused("unlink", fs.unlink(path));
    refused("rename from", fs.rename(path, "taken"));
    refused("rename to", fs.rename("inside/file", path));
    answers
}

#[test]
fn paths_stay_inside() {
    with_outside(|fs, tree, outside| {
        symlink(outside, tree.join("absolute")).unwrap();
        symlink("../outside", tree.join("relative")).unwrap();
        symlink("/proc/self/root", tree.join("magic")).unwrap();
        symlink(
            format!("/proc/{}/cwd", std::process::id()),
            tree.join("cwd"),
        )
        .unwrap();
        symlink(".condor-fs", tree.join("own")).unwrap();
        let secret = outside.join("secret").display().to_string();
        for path in [
            "../outside/secret",
            "../outside/directory/new",
            "inside/../../outside/secret",
            "inside/../../outside/new",
            secret.as_str(),
            "//etc/passwd",
            "/",
            "absolute/secret",
            "absolute/new",
            "relative/secret",
            "relative/directory/new",
            "magic/etc/passwd",
            "cwd/new",
        ] {
            for errno in everything(fs, path) {
                // A link to /proc crosses to another filesystem in any case.
                assert!(
                    matches!(errno, Errno::XDEV | Errno::LOOP),
                    "{path:?}: {errno}"
                );
            }
        }
        for path in [
            ".condor-fs/lock",
            ".condor-fs",
            "inside/../.condor-fs/x",
            "own/lock",
            "own/new",
        ] {
            for errno in everything(fs, path) {
                assert_eq!(errno, Errno::NOENT, "{path:?}");
            }
        }
        everything(fs, "inside\0/file");
        everything(fs, &format!("inside/{}", "n".repeat(256)));
        assert_eq!(
            fs.open(format!("inside/{}", "n".repeat(256)), READ).err(),
            Some(FileError::Errno(Errno::NAMETOOLONG))
        );
        assert_eq!(
            fs.open("p/".repeat(200), READ).err(),
            Some(FileError::Errno(Errno::NAMETOOLONG))
        );
        // What stays inside is allowed.
        symlink("inside", tree.join("link")).unwrap();
        fs.open("link/../inside/./file", READ).unwrap();
        assert_eq!(std::fs::read(tree.join("inside/file")).unwrap(), b"inside");
    });
}

#[test]
fn last_components_are_not_followed_nor_is_anything_opened_but_files() {
    with_outside(|fs, tree, outside| {
        symlink(outside.join("secret"), tree.join("secret")).unwrap();
        symlink(outside.join("new"), tree.join("dangling")).unwrap();
        symlink("inside/file", tree.join("near")).unwrap();
        for name in ["secret", "dangling", "near"] {
            for options in [READ, WRITE, WRITE.create(), WRITE.create().truncate()] {
                assert_eq!(
                    fs.open(name, options).err(),
                    Some(FileError::Errno(Errno::LOOP)),
                    "{name}"
                );
            }
            assert_eq!(
                fs.open(name, WRITE.exclusive()).err(),
                Some(FileError::Errno(Errno::EXIST))
            );
        }
        assert_eq!(
            fs.status("secret").unwrap().mode & 0o170_000,
            0o120_000,
            "the link's own"
        );
        // Links themselves can be moved and removed.
        fs.rename("secret", "inside/secret").unwrap();
        fs.unlink("inside/secret").unwrap();

        let fifo = rustix::fs::FileType::Fifo;
        let mode = rustix::fs::Mode::RWXU;
        rustix::fs::mknodat(rustix::fs::CWD, tree.join("fifo"), fifo, mode, 0).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(tree.join("socket")).unwrap();
        for name in ["fifo", "socket"] {
            for options in [READ, WRITE, WRITE.create()] {
                assert_eq!(
                    fs.open(name, options).err(),
                    Some(FileError::Errno(Errno::OPNOTSUPP)),
                    "{name}"
                );
            }
        }
        // The null device, where this program may make one.
        let device = rustix::fs::makedev(1, 3);
        let kind = rustix::fs::FileType::CharacterDevice;
        if rustix::fs::mknodat(rustix::fs::CWD, tree.join("null"), kind, mode, device).is_ok() {
            assert_eq!(
                fs.open("null", READ).err(),
                Some(FileError::Errno(Errno::OPNOTSUPP))
            );
        }
    });
}

#[test]
fn a_link_that_is_swapped_meanwhile_leads_nowhere() {
    with_outside(|fs, tree, outside| {
        let stop = AtomicBool::new(false);
        std::fs::create_dir(tree.join("swap")).unwrap();
        std::fs::write(tree.join("swap/secret"), b"mine").unwrap();
        symlink(outside, tree.join("other")).unwrap();
        std::thread::scope(|threads| {
            threads.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    let (swap, other) = (tree.join("swap"), tree.join("other"));
                    let flags = rustix::fs::RenameFlags::EXCHANGE;
                    rustix::fs::renameat_with(rustix::fs::CWD, swap, rustix::fs::CWD, other, flags)
                        .unwrap();
                }
            });
            let (mut inside, mut kept_out) = (0, 0);
            for round in 0.. {
                let mut read = [0; 8];
                match fs.open("swap/secret", READ.write()) {
                    Ok(mut file) => match file.read(&mut read) {
                        Ok(len) => {
                            assert_eq!(&read[..len], b"mine");
                            inside += 1;
                        }
                        Err(error) => panic!("{error}"),
                    },
                    Err(FileError::Errno(Errno::XDEV | Errno::LOOP)) => kept_out += 1,
                    Err(error) => panic!("{error}"),
                }
                let _ = fs.open("swap/new", WRITE.create().truncate());
                let _ = fs.rename("swap/new", "swap/renamed");
                let _ = fs.unlink("swap/renamed");
                let _ = fs.make_directory("swap/directory/new");
                if (round > 300 && inside > 0 && kept_out > 0) || round > 30_000 {
                    break;
                }
            }
            stop.store(true, Ordering::Relaxed);
            assert!(
                inside > 0 && kept_out > 0,
                "{inside} inside, {kept_out} kept out"
            );
        });
    });
}
