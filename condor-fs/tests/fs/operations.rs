//! Every operation does what it does on Unix, with the error numbers of Unix.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::os::fd::BorrowedFd;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use crate::support::{StopAtEnd, disk, eventually, with_server};
use condor_fs::server::{FileServer, ServerError, ServerOptions};
use condor_fs::{Buffer, Errno, FileError, OpenOptions};
use condor_mbox::MemoryWindow;
use embedded_io::{Read, SeekFrom, Write};
use rustix::thread::Pid;

const READ: OpenOptions = OpenOptions::new().read();
const WRITE: OpenOptions = OpenOptions::new().write();

#[track_caller]
fn fails<T>(outcome: Result<T, FileError>, errno: Errno) {
    assert_eq!(outcome.err(), Some(FileError::Errno(errno)));
}

/// How often a thread of this process has slept.
fn sleeps(thread: Pid) -> u64 {
    let thread = thread.as_raw_nonzero();
    let status = std::fs::read_to_string(format!("/proc/self/task/{thread}/status")).unwrap();
    let mut lines = status.lines();
    let count = lines.find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    count.unwrap().trim().parse().unwrap()
}

#[test]
fn positions_of_others_leave_that_of_the_file() {
    let disk = disk();
    with_server(disk.path(), "", |fs, own, allocator, _| {
        let mut file = fs.open("f", READ.write().exclusive()).unwrap();
        file.write(b"0123456789").unwrap();
        assert_eq!(file.write_at(b"ab", 3), Ok(2));
        assert_eq!(file.write_at(b"z", 12), Ok(1));
        let mut read = [0; 16];
        assert_eq!(file.read_at(&mut read, 2), Ok(11));
        assert_eq!(&read[..11], b"2ab56789\0\0z");
        assert_eq!(file.read_at(&mut read, 13), Ok(0));
        assert_eq!(
            file.read_at(&mut read, u64::MAX).err(),
            Some(Errno::INVAL.into())
        );
        assert_eq!(file.position(), Ok(10));
        let buffer = Buffer::new(own, allocator, 64).unwrap();
        let (count, buffer) = file.read_buffer_at(buffer, 4, 1).unwrap();
        buffer.memory().read(0, &mut read[..4]).unwrap();
        assert_eq!((count, &read[..4]), (4, &b"12ab"[..]));
        let (count, _) = file.write_buffer_at(buffer, 4, 20).unwrap();
        assert_eq!((count, file.position()), (4, Ok(10)));
        assert_eq!(file.status().unwrap().size, 24);
        let log = fs.open("f", OpenOptions::new().append()).unwrap();
        fails(log.write_at(b"x", 0), Errno::INVAL);
        fails(file.truncate(u64::MAX), Errno::INVAL);
    });
}

#[test]
fn a_directory_is_rewound() {
    let disk = disk();
    with_server(disk.path(), "", |fs, _, _, _| {
        fs.make_directory("d").unwrap();
        for n in 0..300 {
            std::fs::write(disk.path().join(format!("d/{n:030}")), b"").unwrap();
        }
        let mut directory = fs.open_directory("d").unwrap();
        let (mut name, mut left) = ([0; 64], 0);
        // More than one answer's worth, from the beginning, from the middle of an answer, from the end.
        for read in [10, 250, usize::MAX] {
            directory.rewind();
            left = 0;
            while left < read && directory.next(&mut name).unwrap().is_some() {
                left += 1;
            }
        }
        assert_eq!(left, 300);
        std::fs::write(disk.path().join("d/new"), b"").unwrap();
        directory.rewind();
        let mut names = std::collections::BTreeSet::new();
        while let Some(entry) = directory.next(&mut name).unwrap() {
            assert!(names.insert(entry.name.to_vec()), "each once");
        }
        assert!(names.len() == 301 && names.contains(&b"new"[..]));
        assert!(directory.status().unwrap().is_directory());
    });
}

#[test]
fn a_server_that_has_nothing_to_do_sleeps_until_it_is_rung() {
    // It looks ten times in each of the tenths of a second in which more may come, and then hardly.
    const WHILE: Duration = Duration::from_millis(200);
    let disk = disk();
    let system = crate::support::system();
    let stop = AtomicBool::new(false);
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::scope(|threads| {
        let _ends = StopAtEnd(&stop);
        threads.spawn(|| {
            tell.send(rustix::thread::gettid()).unwrap();
            let server = FileServer::new(disk.path(), ServerOptions::default()).unwrap();
            let claim = system.claim(crate::support::SERVER).unwrap();
            server.serve(claim, &stop).unwrap();
        });
        let server = told.recv().unwrap();
        crate::support::with_client(&system, crate::support::CLIENT, |fs, _, _, _| {
            eventually(|| {
                eventually(|| {
                    let before = sleeps(server);
                    std::thread::sleep(WHILE);
                    let slept = sleeps(server) - before;
                    (slept <= 3).then_some(()).ok_or("it does not sleep")
                });
                // The end of its sleep would be later.
                let begun = std::time::Instant::now();
                fs.open("data", WRITE.create()).unwrap().close().unwrap();
                let is_quick = begun.elapsed() < WHILE / 4;
                is_quick.then_some(()).ok_or("a ring does not wake it")
            });
        });
    });
}

#[test]
fn a_file_is_written_and_read() {
    let disk = disk();
    with_server(disk.path(), "", |fs, _, _, _| {
        let mut file = fs.open("data", WRITE.read().create()).unwrap();
        let bytes: Vec<u8> = (0..10_000_u32).map(|n| (n % 251) as u8).collect();
        assert_eq!(file.write(&bytes).unwrap(), 4096, "its buffer is no longer");
        file.write_all(&bytes[4096..]).unwrap();
        assert_eq!(file.position().unwrap(), 10_000);
        assert_eq!(std::fs::read(disk.path().join("data")).unwrap(), bytes);

        assert_eq!(file.seek(SeekFrom::Start(5)).unwrap(), 5);
        let mut read = vec![0; 9_995];
        file.read_exact(&mut read).unwrap();
        assert_eq!(read, bytes[5..]);
        assert_eq!(file.read(&mut read).unwrap(), 0);
        assert_eq!(file.seek(SeekFrom::End(-10)).unwrap(), 9_990);
        assert_eq!(file.seek(SeekFrom::Current(-90)).unwrap(), 9_900);
        assert_eq!(file.read(&mut read).unwrap(), 100);
        fails(file.seek(SeekFrom::Current(-10_001)), Errno::INVAL);

        file.truncate(3).unwrap();
        file.sync().unwrap();
        assert_eq!(file.status().unwrap().size, 3);
        file.close().unwrap();
        let status = fs.status("data").unwrap();
        assert!(status.is_file() && status.size == 3 && status.links == 1);

        let mut log = fs.open("data", OpenOptions::new().append()).unwrap();
        log.write(b"after").unwrap();
        std::fs::write(disk.path().join("data"), b"other").unwrap();
        log.write(b"!").unwrap();
        fails(log.read(&mut read), Errno::BADF);
        assert_eq!(std::fs::read(disk.path().join("data")).unwrap(), b"other!");
        let mut reader = fs.open("data", READ).unwrap();
        fails(reader.write(b"x"), Errno::BADF);
        fails(reader.truncate(0), Errno::INVAL);
    });
}

#[test]
fn buffers_are_lent_without_a_copy() {
    let disk = disk();
    with_server(disk.path(), "", |fs, own, allocator, _| {
        let mut file = fs.open("data", WRITE.read().create()).unwrap();
        let buffer = Buffer::new(own, allocator, 65_536).unwrap();
        let data: Vec<u8> = (0..65_536_u32).map(|n| (n / 7) as u8).collect();
        buffer.memory().write(0, &data).unwrap();
        let (written, buffer) = file.write_buffer(buffer, 65_535).unwrap();
        assert_eq!(written, 65_535);
        assert_eq!(
            std::fs::read(disk.path().join("data")).unwrap(),
            data[..65_535]
        );
        file.seek(SeekFrom::Start(1)).unwrap();
        let (read, buffer) = file.read_buffer(buffer, 65_536).unwrap();
        assert_eq!(read, 65_534);
        let mut back = vec![0; read];
        buffer.memory().read(0, &mut back).unwrap();
        assert_eq!(back, data[1..65_535]);
        let kept = file.read_buffer(buffer, 65_540).unwrap_err();
        assert_eq!(kept.error, FileError::Errno(Errno::FAULT));
        assert!(kept.buffer.is_some());
    });
}

#[test]
fn opening_asks_for_what_it_asks_for() {
    let disk = disk();
    std::fs::write(disk.path().join("old"), b"old").unwrap();
    std::fs::create_dir(disk.path().join("directory")).unwrap();
    with_server(disk.path(), "", |fs, _, _, _| {
        fails(fs.open("none", READ), Errno::NOENT);
        fails(fs.open("old", OpenOptions::new()), Errno::INVAL);
        fails(fs.open("old", READ.truncate()), Errno::INVAL);
        fails(fs.open("old", WRITE.exclusive()), Errno::EXIST);
        fails(fs.open("directory", READ), Errno::ISDIR);
        fails(fs.open("old/file", READ), Errno::NOTDIR);
        fails(fs.open_directory("old"), Errno::NOTDIR);
        fails(fs.open("", READ), Errno::NOENT);
        let mut new = fs.open("directory/new", WRITE.exclusive()).unwrap();
        new.write(b"1").unwrap();
        new.close().unwrap();
        fs.open("old", WRITE.create().truncate())
            .unwrap()
            .close()
            .unwrap();
        assert_eq!(std::fs::read(disk.path().join("old")).unwrap(), b"");

        let files: Vec<_> = (0..crate::support::FILES)
            .map(|_| fs.open("old", READ).unwrap())
            .collect();
        fails(fs.open("old", READ), Errno::MFILE);
        drop(files);
        fs.open("old", READ).unwrap();
    });
}

#[test]
fn directories_are_made_read_and_removed() {
    let disk = disk();
    with_server(disk.path(), "", |fs, _, _, _| {
        fs.make_directory("d").unwrap();
        fails(fs.make_directory("d"), Errno::EXIST);
        fails(fs.make_directory("none/d"), Errno::NOENT);
        fs.make_directory("d/sub/").unwrap();
        for n in 0..300 {
            let mut file = fs.open(format!("d/file {n}"), WRITE.create()).unwrap();
            file.write(b"x").unwrap();
        }
        fails(fs.remove_directory("d"), Errno::NOTEMPTY);
        fails(fs.unlink("d"), Errno::ISDIR);
        fails(fs.remove_directory("d/file 1"), Errno::NOTDIR);
        let mut names = Vec::new();
        let mut directory = fs.open_directory("d").unwrap();
        let mut name = [0; 255];
        while let Some(entry) = directory.next(&mut name).unwrap() {
            assert_eq!(entry.is_directory(), entry.name == b"sub");
            names.push(String::from_utf8(entry.name.into()).unwrap());
        }
        directory.close().unwrap();
        names.sort();
        let mut expected: Vec<_> = (0..300).map(|n| format!("file {n}")).collect();
        expected.push("sub".into());
        expected.sort();
        assert_eq!(names, expected);
        for n in 0..300 {
            fs.unlink(format!("d/file {n}")).unwrap();
        }
        fails(fs.unlink("d/file 1"), Errno::NOENT);
        fs.remove_directory("d/sub").unwrap();
        fs.remove_directory("d").unwrap();
        let mut top = fs.open_directory(".").unwrap();
        assert_eq!(
            top.next(&mut name).unwrap(),
            None,
            "the server's own is not seen"
        );
    });
}

#[test]
fn renames_replace_as_on_unix() {
    let disk = disk();
    let at = |name: &str| disk.path().join(name);
    std::fs::write(at("a"), b"a").unwrap();
    std::fs::write(at("b"), b"b").unwrap();
    std::fs::create_dir_all(at("d/e")).unwrap();
    with_server(disk.path(), "", |fs, _, _, _| {
        fails(fs.rename_new("a", "b"), Errno::EXIST);
        fs.rename("a", "b").unwrap();
        assert_eq!(std::fs::read(at("b")).unwrap(), b"a");
        fails(fs.rename("a", "c"), Errno::NOENT);
        fails(fs.rename("d", "d/e/f"), Errno::INVAL);
        fails(fs.rename("b", "d"), Errno::ISDIR);
        fs.rename("b", "b").unwrap();
        fs.rename("d", "x").unwrap();
        assert!(at("x/e").is_dir());
    });
}

#[test]
fn open_files_outlive_their_names() {
    let disk = disk();
    let system = crate::support::system();
    let supervisor = crate::support::Supervisor::start(&system, disk.path(), None, "");
    crate::support::with_client(&system, crate::support::CLIENT, |fs, _, _, _| {
        let mut read = [0; 8];
        fs.make_directory("d").unwrap();
        let mut gone = fs.open("gone", WRITE.read().create()).unwrap();
        gone.write(b"still").unwrap();
        let mut replaced = fs.open("replaced", WRITE.read().create()).unwrap();
        replaced.write(b"there").unwrap();
        let mut moved = fs.open("d/moved", WRITE.read().create()).unwrap();
        moved.write(b"moved").unwrap();
        fs.open("new", WRITE.create()).unwrap().close().unwrap();
        fs.unlink("gone").unwrap();
        fs.rename("new", "replaced").unwrap();
        fs.rename("d", "longer name").unwrap();
        supervisor.die();
        // What is there now under the old names is something else.
        fs.open("gone", WRITE.create()).unwrap().close().unwrap();
        for (file, text) in [
            (&mut gone, b"still"),
            (&mut replaced, b"there"),
            (&mut moved, b"moved"),
        ] {
            file.seek(SeekFrom::Start(0)).unwrap();
            assert_eq!(file.read(&mut read).unwrap(), 5);
            assert_eq!(&read[..5], text);
        }
        assert_eq!(gone.status().unwrap().links, 0);
        gone.close().unwrap();
        replaced.close().unwrap();
        moved.close().unwrap();
        // Somebody else's change is no business of ours, and is noticed.
        let mut stale = fs.open("gone", WRITE.read()).unwrap();
        std::fs::remove_file(disk.path().join("gone")).unwrap();
        std::fs::write(disk.path().join("gone"), b"other").unwrap();
        supervisor.die();
        fails(stale.read(&mut read), Errno::STALE);
    });
    drop(supervisor);
    let names: Vec<_> = crate::support::snapshot(disk.path())
        .into_iter()
        .map(|(name, _)| name)
        .collect();
    assert_eq!(
        names,
        [
            ".condor-fs",
            "gone",
            "longer name",
            "longer name/moved",
            "replaced"
        ]
    );
}

#[test]
fn a_read_only_tree_stays_as_it_is() {
    let disk = disk();
    std::fs::write(disk.path().join("a"), b"a").unwrap();
    with_server(disk.path(), "read-only", |fs, _, _, _| {
        fails(fs.open("a", WRITE), Errno::ROFS);
        fails(fs.open("b", WRITE.create()), Errno::ROFS);
        fails(fs.make_directory("b"), Errno::ROFS);
        fails(fs.unlink("a"), Errno::ROFS);
        fails(fs.rename("a", "b"), Errno::ROFS);
        let mut a = fs.open("a", READ).unwrap();
        let mut read = [0; 4];
        assert_eq!(a.read(&mut read).unwrap(), 1);
    });
}

#[test]
fn limits_of_size_are_kept() {
    let disk = disk();
    with_server(disk.path(), "max-file=1000", |fs, _, _, _| {
        let mut a = fs.open("a", WRITE.create()).unwrap();
        a.write(&[1; 1000]).unwrap();
        fails(a.write(b"1"), Errno::FBIG);
        fails(a.truncate(1001), Errno::FBIG);
        a.truncate(10).unwrap();
    });
    with_server(disk.path(), "quota=4000", |fs, _, _, _| {
        // Each of the two names counts 1024.
        let mut b = fs.open("b", WRITE.create()).unwrap();
        b.write(&[1; 1900]).unwrap();
        fails(b.write(&[1; 100]), Errno::DQUOT);
        fs.unlink("a").unwrap();
        b.write(&[1; 1076]).unwrap();
        fails(b.write(&[1; 1]), Errno::DQUOT);
        b.seek(SeekFrom::Start(0)).unwrap();
        b.write(&[2; 1900]).unwrap();
    });
}

#[test]
fn a_tree_has_one_server() {
    let disk = disk();
    let first = FileServer::new(disk.path(), ServerOptions::default()).unwrap();
    let second = FileServer::new(disk.path(), ServerOptions::default());
    assert!(matches!(second, Err(ServerError::Served { root }) if root == disk.path()));
    // As a process has it that another thread has forked and that has not executed its program yet.
    let lock = disk.path().canonicalize().unwrap().join(".condor-fs/lock");
    let lock = std::fs::read_dir("/proc/self/fd")
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|file| std::fs::read_link(file).is_ok_and(|target| target == lock))
        .unwrap();
    let number = lock.file_name().unwrap().to_str().unwrap();
    // SAFETY: the server has it open until it is dropped below.
    let lock = unsafe { BorrowedFd::borrow_raw(number.parse().unwrap()) };
    let forked = lock.try_clone_to_owned().unwrap();
    drop(first);
    FileServer::new(disk.path(), ServerOptions::default()).unwrap();
    drop(forked);
}
