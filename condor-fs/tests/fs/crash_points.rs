//! The server dies at every step of every operation; the next one goes on, and everything has taken
//! effect once.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::collections::BTreeSet;
use std::path::Path;

use crate::support::{CLIENT, Fs, Kill, OTHER, Supervisor, disk, snapshot, system, with_client};
use condor_fs::server::Step;
use condor_fs::wire::Operation;
use condor_fs::{AllocationMode, Errno, FileStatus, OpenOptions, SetTime, Times};
use embedded_io::SeekFrom;

/// Every operation, at least twice, with its failures, and what would show that one was done
/// twice, or to a file that has the inode of a former one. Gives what the client saw.
fn program(fs: &Fs<'_, '_>) -> Vec<String> {
    let mut seen = Vec::new();
    let mut note = |what: &str, outcome: Result<u64, condor_fs::FileError>| {
        seen.push(match outcome {
            Ok(value) => format!("{what}: {value}"),
            Err(condor_fs::FileError::Errno(errno)) => format!("{what}: {errno:?}"),
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
    attributes(fs, &mut note);
    exchanges(fs, &mut note);
    ranges(fs, &mut note);
    let mut names = Vec::new();
    let mut directory = fs.open_directory("d").unwrap();
    note("sync directory", directory.sync().map(|()| 0));
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

/// Modes and times: what is set twice, or on another file, is seen by what other operations set.
fn attributes(fs: &Fs<'_, '_>, note: &mut impl FnMut(&str, Result<u64, condor_fs::FileError>)) {
    let at = |s| SetTime::At { s, ns: 7 };
    let both = |accessed, modified| Times { accessed, modified };
    let mode = |status: FileStatus| u64::from(status.mode);
    let read = OpenOptions::new().read();
    note("mkdir 3", fs.make_directory_with("m", 0o700).map(|()| 0));
    note("mode of m", fs.status("m").map(mode));
    let file = fs.open("m/new", read.exclusive().mode(0o440)).unwrap();
    note("mode of new", file.status().map(mode));
    note("write to it", { file }.write(b"x").map(|n| n as u64));
    let file = fs.open("m/plain", read.create().mode(0o604)).unwrap();
    note("mode of plain", file.status().map(mode));
    note("set file mode", file.set_mode(0o640).map(|()| 0));
    note("set file mode 2", file.set_mode(0o600).map(|()| 0));
    note("set path mode", fs.set_mode("m/new", 0o400).map(|()| 0));
    note("set path mode 2", fs.set_mode("m/none", 0o400).map(|()| 0));
    note("set no mode", fs.set_mode("m/new", 0o10_000).map(|()| 0));
    note(
        "set owner's rights",
        fs.set_mode("m/new", 0o4755).map(|()| 0),
    );
    note("mode of m/new", fs.status("m/new").map(mode));
    note("mode of m/plain", fs.status("m/plain").map(mode));
    let times = both(at(1000), at(2000));
    note("set file times", file.set_times(times).map(|()| 0));
    let times = both(SetTime::Keep, at(3000));
    note("set file times 2", file.set_times(times).map(|()| 0));
    let status = file.status().unwrap();
    note("accessed", Ok(status.accessed_s));
    note("modified", Ok(status.modified_s));
    note("nanoseconds", Ok(status.modified_ns.into()));
    note(
        "set path times",
        fs.set_times("m", both(at(4000), at(5000))).map(|()| 0),
    );
    let bad = SetTime::At {
        s: 0,
        ns: 1_000_000_000,
    };
    note(
        "set no times",
        fs.set_times("m", both(bad, SetTime::Now)).map(|()| 0),
    );
    note(
        "m was modified",
        fs.status("m").map(|status| status.modified_s),
    );
    note(
        "set times to now",
        fs.set_times("m", both(SetTime::Now, SetTime::Now))
            .map(|()| 0),
    );
    let now = fs.status("m").unwrap();
    note("now", Ok(u64::from(now.modified_s > 1_600_000_000)));
    let space = fs.space().unwrap();
    note(
        "space",
        Ok(u64::from(
            space.blocks > space.free && space.block_bytes > 0,
        )),
    );
    file.close().unwrap();
    for name in ["m/new", "m/plain"] {
        note("unlink", fs.unlink(name).map(|()| 0));
    }
    note("rmdir 2", fs.remove_directory("m").map(|()| 0));
}

/// An exchange that is done twice is none, and what is open keeps its contents.
fn exchanges(fs: &Fs<'_, '_>, note: &mut impl FnMut(&str, Result<u64, condor_fs::FileError>)) {
    let new = OpenOptions::new().read().write().exclusive();
    fs.make_directory("x").unwrap();
    let mut one = fs.open("x/one", new).unwrap();
    let mut two = fs.open("x/two", new).unwrap();
    note("write one", one.write(b"1").map(|n| n as u64));
    note("write two", two.write(b"22").map(|n| n as u64));
    note("exchange", fs.exchange("x/one", "x/two").map(|()| 0));
    note("exchange none", fs.exchange("x/one", "x/none").map(|()| 0));
    note("exchange inside", fs.exchange("x", "x/two").map(|()| 0));
    let size = |path| fs.status(path).map(|status| status.size);
    note("size of x/one", size("x/one"));
    note("size of x/two", size("x/two"));
    // Only a path that was exchanged, too, leads to a file that is opened again.
    note("size of one", one.status().map(|status| status.size));
    note("size of two", two.status().map(|status| status.size));
    fs.make_directory("y").unwrap();
    note("exchange directory", fs.exchange("x", "y").map(|()| 0));
    note("exchange with file", fs.exchange("x", "y/one").map(|()| 0));
    note("write two again", two.write(b"2").map(|n| n as u64));
    // Who unlinks it has it open, too.
    note("unlink two", fs.unlink("x").map(|()| 0));
    note(
        "links of two",
        two.status().map(|status| status.links.into()),
    );
    note(
        "links of one",
        one.status().map(|status| status.links.into()),
    );
    drop((one, two));
    note("unlink one", fs.unlink("y/two").map(|()| 0));
    for name in ["y/one", "y"] {
        note("rmdir 3", fs.remove_directory(name).map(|()| 0));
    }
}

/// Holes and room: what is done to another range, or after a later write, is seen in the contents.
fn ranges(fs: &Fs<'_, '_>, note: &mut impl FnMut(&str, Result<u64, condor_fs::FileError>)) {
    const HOLE: u64 = 64 * 1024; // Longer than a block of any filesystem here.
    let new = OpenOptions::new().read().write().exclusive();
    let mut file = fs.open("sparse", new).unwrap();
    let found = |place: Result<Option<u64>, _>| place.map(|place| place.unwrap_or(u64::MAX));
    note("data in nothing", found(file.next_data(0)));
    note("seek 5", file.seek(SeekFrom::Start(HOLE)));
    note("write 7", file.write(b"data").map(|n| n as u64));
    note("first data", found(file.next_data(0)));
    note("first hole", found(file.next_hole(0)));
    note("last hole", found(file.next_hole(HOLE)));
    note("no hole", found(file.next_hole(HOLE + 4)));
    note("hole beyond", found(file.next_hole(u64::MAX)));
    let allocate = |what, position, len| file.allocate(what, position, len).map(|()| 0);
    note("allocate", allocate(AllocationMode::Extend, 0, 3 * HOLE));
    note(
        "allocate 2",
        allocate(AllocationMode::KeepSize, 0, 4 * HOLE),
    );
    note("allocate nothing", allocate(AllocationMode::Extend, 0, 0));
    note(
        "allocate all",
        allocate(AllocationMode::Extend, 1, u64::MAX),
    );
    note("zero", allocate(AllocationMode::Zero, HOLE + 1, 2));
    note(
        "zero 2",
        allocate(AllocationMode::ZeroKeepSize, 2 * HOLE, 4 * HOLE),
    );
    note("allocated", file.status().map(|status| status.size));
    note("punch", allocate(AllocationMode::PunchHole, 2 * HOLE, HOLE));
    note("hole again", found(file.next_hole(HOLE)));
    note("seek 6", file.seek(SeekFrom::Start(HOLE)));
    let mut read = [0; 8];
    note("read 4", file.read(&mut read).map(|n| n as u64));
    assert_eq!(&read, b"d\0\0a\0\0\0\0");
    let write = fs.open("sparse", OpenOptions::new().read()).unwrap();
    note(
        "allocate to read",
        write.allocate(AllocationMode::Extend, 0, 1).map(|()| 0),
    );
    note("unlink sparse", fs.unlink("sparse").map(|()| 0));
    note("links", file.status().map(|status| status.links.into()));
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

/// What some of them give.
const VALUES: [(&str, u64); 24] = [
    ("size of x/one", 2),
    ("size of x/two", 1),
    ("size of one", 1),
    ("size of two", 2),
    ("links of two", 0),
    ("links of one", 1),
    ("data in nothing", u64::MAX),
    ("first data", 65_536),
    ("first hole", 0),
    ("no hole", u64::MAX),
    ("hole beyond", u64::MAX),
    ("allocated", 3 * 65_536),
    ("links", 0),
    ("mode of m", 0o40_700),
    ("mode of new", 0o100_440),
    ("mode of plain", 0o100_604),
    ("mode of m/new", 0o100_400),
    ("mode of m/plain", 0o100_600),
    ("accessed", 1000),
    ("modified", 3000),
    ("nanoseconds", 7),
    ("m was modified", 5000),
    ("now", 1),
    ("space", 1),
];

/// How some of them fail.
const ERRORS: [(&str, Errno); 17] = [
    ("exchange none", Errno::NOENT),
    ("exchange inside", Errno::INVAL),
    ("allocate nothing", Errno::INVAL),
    ("allocate all", Errno::INVAL),
    ("allocate to read", Errno::BADF),
    ("mkdir again", Errno::EXIST),
    ("exclusive", Errno::EXIST),
    ("unlink again", Errno::NOENT),
    ("rename again", Errno::NOENT),
    ("rename new", Errno::EXIST),
    ("rmdir full", Errno::NOTEMPTY),
    ("rmdir again", Errno::NOENT),
    ("write to it", Errno::BADF),
    ("set path mode 2", Errno::NOENT),
    ("set no mode", Errno::INVAL),
    ("set owner's rights", Errno::PERM),
    ("set no times", Errno::INVAL),
];

/// Where a server must have died.
const POINTS: [&str; 54] = [
    "Find Acted",
    "Allocate Begun",
    "Allocate Part",
    "Allocate Acted",
    "Allocate Recorded",
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
    "FileMode Begun",
    "FileMode Acted",
    "FileMode Recorded",
    "PathMode Begun",
    "PathMode Acted",
    "PathMode Recorded",
    "FileTimes Begun",
    "FileTimes Acted",
    "FileTimes Recorded",
    "PathTimes Begun",
    "PathTimes Acted",
    "PathTimes Recorded",
    "Space Acted",
];

#[test]
fn every_operation_takes_effect_once_wherever_the_server_dies() {
    let first = disk();
    let (expected, tree, deaths) = run(first.path(), None);
    assert_eq!(deaths, 0);
    // What Unix does, from the filesystem's own mouth.
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
    for (what, errno) in ERRORS {
        assert!(
            expected.contains(&format!("{what}: {errno:?}")),
            "{what} in {expected:?}"
        );
    }

    for (what, value) in VALUES {
        assert!(
            expected.contains(&format!("{what}: {value}")),
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
    for point in POINTS {
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
