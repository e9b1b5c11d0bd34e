//! The server dies at every step of every operation; the next one goes on, and everything has taken
//! effect once.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::collections::BTreeSet;
use std::path::Path;

use crate::support::{CLIENT, Fs, Kill, OTHER, Supervisor, disk, snapshot, system, with_client};
use condor_fs::server::Step;
use condor_fs::wire::Operation;
use condor_fs::{Errno, OpenOptions};
use embedded_io::SeekFrom;

/// Every operation, at least twice, with its failures, and what would show that one was done
/// twice, or to a file that has the inode of a former one. Gives what the client saw.
fn program(fs: &Fs<'_, '_>) -> Vec<String> {
    let mut seen = Vec::new();
    let mut note = |what: &str, outcome: Result<u64, condor_fs::Error>| {
        seen.push(match outcome {
            Ok(value) => format!("{what}: {value}"),
            Err(condor_fs::Error::Errno(errno)) => format!("{what}: {errno:?}"),
            Err(other) => panic!("{what}: {other}"),
        });
    };
    let write = OpenOptions::new().write();
    note("mkdir", fs.make_directory("d").map(|()| 0));
    note("mkdir again", fs.make_directory("d").map(|()| 0));
    note("mkdir 2", fs.make_directory("d/e").map(|()| 0));
    {
        let mut file = fs.open("d/file", write.read().exclusive()).unwrap();
        note("exclusive", fs.open("d/file", write.exclusive()).map(|_| 0));
        note("write", file.write(b"0123456789").map(|n| n as u64));
        note("seek", file.seek(SeekFrom::Start(4)));
        note("write 2", file.write(b"abc").map(|n| n as u64));
        note("truncate", file.truncate(8).map(|()| 0));
        note("sync", file.sync().map(|()| 0));
        note("status", file.status().map(|status| status.size));
        note("seek 2", file.seek(SeekFrom::Start(2)));
        let mut read = [0; 16];
        note("read", file.read(&mut read).map(|n| n as u64));
        assert_eq!(&read[..6], b"23abc7");
        // What is appended twice is seen; so is what was appended where another append is.
        let mut log = fs
            .open("log", OpenOptions::new().append().create())
            .unwrap();
        for line in ["one ", "two ", "three "] {
            note("append", log.write(line.as_bytes()).map(|n| n as u64));
        }
        note("close", log.close().map(|()| 0));
        let mut lines = fs.open("log", OpenOptions::new().read()).unwrap();
        note("read log", lines.read(&mut read).map(|n| n as u64));
        assert_eq!(&read[..14], b"one two three ");
        note("close log", lines.close().map(|()| 0));
        let mut again = fs.open("log", write.truncate().create()).unwrap();
        note("write 3", again.write(b"new").map(|n| n as u64));
        // Goes on under a silly name, while a file of the same name comes into being.
        note("unlink open", fs.unlink("d/file").map(|()| 0));
        note("unlink again", fs.unlink("d/file").map(|()| 0));
        let mut other = fs.open("d/file", write.exclusive()).unwrap();
        note("write 4", other.write(b"other").map(|n| n as u64));
        note("seek 3", file.seek(SeekFrom::Start(0)));
        note("read 2", file.read(&mut read).map(|n| n as u64));
        assert_eq!(&read[..8], b"0123abc7");
        note("close 2", file.close().map(|()| 0));
    }
    // A removal that is done twice takes the file that has the name now, and perhaps the inode.
    for round in 0..3_u8 {
        note("unlink", fs.unlink("d/file").map(|()| 0));
        let mut file = fs.open("d/file", write.exclusive()).unwrap();
        note("write 5", file.write(&[b'a' + round]).map(|n| n as u64));
    }
    note("rename", fs.rename("d/file", "d/moved").map(|()| 0));
    note("rename again", fs.rename("d/file", "d/moved").map(|()| 0));
    {
        let mut file = fs.open("d/file", write.exclusive().read()).unwrap();
        note("write 6", file.write(b"second").map(|n| n as u64));
        note("rename over", fs.rename("d/moved", "d/file").map(|()| 0));
        note("rename new", fs.rename_new("log", "d/file").map(|()| 0));
        note("seek 4", file.seek(SeekFrom::Start(0)));
        let mut read = [0; 16];
        note("read 3", file.read(&mut read).map(|n| n as u64));
        assert_eq!(&read[..6], b"second");
    }
    note("rename directory", fs.rename("d/e", "e").map(|()| 0));
    note("make again", fs.make_directory("d/e").map(|()| 0));
    note("rmdir full", fs.remove_directory("d").map(|()| 0));
    note("rmdir", fs.remove_directory("e").map(|()| 0));
    note("rmdir again", fs.remove_directory("e").map(|()| 0));
    let mut names = Vec::new();
    let mut directory = fs.open_directory("d").unwrap();
    let mut name = [0; 64];
    while let Some(entry) = directory.next(&mut name).unwrap() {
        names.push(String::from_utf8(entry.name.to_vec()).unwrap());
    }
    names.sort();
    note(&format!("names {names:?}"), directory.close().map(|()| 0));
    note("status 2", fs.status("log").map(|status| status.size));
    // So that all that was left open is closed.
    let last = fs.open("log", OpenOptions::new().read()).unwrap();
    note("close 3", last.close().map(|()| 0));
    seen
}

type Seen = (Vec<String>, Vec<(String, Option<Vec<u8>>)>, u32);

fn run(root: &Path, kill: Option<Kill>) -> Seen {
    let system = system();
    let supervisor = Supervisor::start(&system, root, kill, "");
    let seen = with_client(&system, CLIENT, |fs, _, _, _| program(fs));
    let deaths = supervisor.deaths();
    drop(supervisor);
    (seen, snapshot(root), deaths)
}

#[test]
fn every_operation_takes_effect_once_wherever_the_server_dies() {
    let first = disk();
    let (expected, tree, deaths) = run(first.path(), None);
    assert_eq!(deaths, 0);
    // What Unix does, from the file system's own mouth.
    let reference = [
        (".condor-fs", None),
        ("d", None),
        ("d/e", None),
        ("d/file", Some("c")),
        ("log", Some("new")),
    ];
    let found: Vec<_> = tree
        .iter()
        .map(|(name, data)| {
            (
                name.as_str(),
                data.as_deref()
                    .map(|data| std::str::from_utf8(data).unwrap()),
            )
        })
        .collect();
    assert_eq!(found, reference);
    for (what, errno) in [
        ("mkdir again", Errno::EXIST),
        ("exclusive", Errno::EXIST),
        ("unlink again", Errno::NOENT),
        ("rename again", Errno::NOENT),
        ("rename new", Errno::EXIST),
        ("rmdir full", Errno::NOTEMPTY),
        ("rmdir again", Errno::NOENT),
    ] {
        assert!(
            expected.contains(&format!("{what}: {errno:?}")),
            "{what} in {expected:?}"
        );
    }

    let mut died = BTreeSet::new();
    for operation in Operation::ALL {
        for step in Step::ALL {
            for count in [1, 2, 4] {
                let root = disk();
                let (seen, left, deaths) = run(root.path(), Some((operation, step, count)));
                let at = format!("{operation:?} {step:?} {count}");
                assert_eq!(seen, expected, "{at}");
                assert_eq!(left, tree, "{at}");
                assert!(deaths <= 1, "{at}");
                if deaths == 0 {
                    break; // It never comes there so often.
                }
                died.insert(format!("{operation:?} {step:?}"));
            }
        }
    }
    for point in [
        "Session Recorded",
        "Open Made",
        "Open Staged",
        "Open Moved",
        "Open Acted",
        "Close Acted",
        "Read Part",
        "Write Begun",
        "Write Part",
        "Write Acted",
        "Write Recorded",
        "Append Begun",
        "Append Staged",
        "Append Part",
        "Append Acted",
        "Append Recorded",
        "Truncate Acted",
        "Sync Acted",
        "FileStatus Acted",
        "PathStatus Acted",
        "ReadDirectory Acted",
        "MakeDirectory Made",
        "MakeDirectory Staged",
        "MakeDirectory Recorded",
        "RemoveDirectory Staged",
        "RemoveDirectory Acted",
        "Unlink Staged",
        "Unlink Aside",
        "Unlink Marked",
        "Unlink Acted",
        "Unlink Recorded",
        "Rename Staged",
        "Rename Moved",
        "Rename Aside",
        "Rename Marked",
        "Rename Recorded",
    ] {
        assert!(
            died.contains(point),
            "the server never died at {point}: {died:?}"
        );
    }
}

/// What one client has written is not undone by the other's write that is done again.
#[test]
fn nobody_sees_the_tree_between_two_halves() {
    for (operation, step) in [
        (Operation::Write, Step::Part),
        (Operation::Append, Step::Part),
        (Operation::Truncate, Step::Acted),
        (Operation::Unlink, Step::Acted),
        (Operation::Rename, Step::Moved),
    ] {
        let root = disk();
        std::fs::write(root.path().join("f"), b"....").unwrap();
        let system = system();
        let supervisor = Supervisor::start(&system, root.path(), Some((operation, step, 1)), "");
        let write = OpenOptions::new().write();
        std::thread::scope(|threads| {
            let other = threads.spawn(|| {
                with_client(&system, OTHER, |fs, _, _, _| {
                    // Only once the first is in the middle of its operation.
                    while supervisor.deaths() == 0 {
                        std::thread::yield_now();
                    }
                    match operation {
                        Operation::Unlink | Operation::Rename => {
                            let mut file = fs.open("f", write.exclusive()).unwrap();
                            file.write(b"B").unwrap();
                        }
                        _ => {
                            let mut file = fs.open("f", OpenOptions::new().append()).unwrap();
                            file.write(b"B").unwrap();
                        }
                    }
                });
            });
            with_client(&system, CLIENT, |fs, _, _, _| match operation {
                Operation::Write => {
                    fs.open("f", write).unwrap().write(b"AAAAAAAA").unwrap();
                }
                Operation::Append => {
                    let append = OpenOptions::new().append();
                    fs.open("f", append).unwrap().write(b"AAAA").unwrap();
                }
                Operation::Truncate => fs.open("f", write).unwrap().truncate(2).unwrap(),
                Operation::Unlink => fs.unlink("f").unwrap(),
                _ => fs.rename("f", "g").unwrap(),
            });
            other.join().unwrap();
        });
        let expected: &[u8] = match operation {
            Operation::Write => b"AAAAAAAAB",
            Operation::Append => b"....AAAAB",
            Operation::Truncate => b"..B",
            _ => b"B",
        };
        let found = std::fs::read(root.path().join("f")).unwrap();
        assert_eq!(found, expected, "{operation:?}");
        assert_eq!(supervisor.deaths(), 1);
    }
}
