//! What a timeout leaves behind, and how it ends.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::time::Duration;

use crate::support::{CLIENT, Supervisor, TIMEOUT, disk, system, with_client};
use condor_fs::{Buffer, FileError, OpenOptions};
use condor_mbox::MemoryWindow;

const SHORT: Duration = Duration::from_millis(20);

fn not_begun(error: FileError) -> bool {
    matches!(
        error,
        FileError::NotBegun {
            server: crate::support::SERVER,
            cause: Some(_)
        }
    )
}

fn timed_out(error: FileError) -> bool {
    matches!(
        error,
        FileError::TimedOut {
            server: crate::support::SERVER,
            cause: Some(_),
            ..
        }
    )
}

#[test]
fn an_operation_in_doubt_is_done_once_by_the_next_server() {
    let root = disk();
    let system = system();
    let first = Supervisor::start(&system, root.path(), None, "");
    with_client(&system, CLIENT, |fs, own, allocator, _| {
        let append = OpenOptions::new().append().create();
        let mut log = fs.open("log", append).unwrap();
        let mut data = fs
            .open("data", OpenOptions::new().write().create())
            .unwrap();
        assert_eq!(fs.settle(TIMEOUT).unwrap(), None);
        drop(first);

        // No server: the operation stays, and so does every later one's wait for it.
        fs.set_timeout(SHORT);
        assert!(timed_out(log.write(b"one ").unwrap_err()));
        assert!(fs.in_doubt());
        assert!(not_begun(log.write(b"two ").unwrap_err()));
        assert!(not_begun(fs.unlink("log").unwrap_err()));
        assert!(timed_out(fs.settle(SHORT).unwrap_err()));
        let second = Supervisor::start(&system, root.path(), None, "");
        assert_eq!(fs.settle(TIMEOUT).unwrap(), Some(Ok(4)));
        assert!(!fs.in_doubt());
        assert_eq!(log.position().unwrap(), 4, "as if it had been in time");
        fs.set_timeout(TIMEOUT);
        log.write(b"three").unwrap();
        assert_eq!(
            std::fs::read(root.path().join("log")).unwrap(),
            b"one three"
        );

        // A lent buffer is nobody's until its operation has ended.
        drop(second);
        fs.set_timeout(SHORT);
        let buffer = Buffer::new(own, allocator, 4096).unwrap();
        buffer.memory().write(0, &[9; 4096]).unwrap();
        let kept = data.write_buffer(buffer, 4096).unwrap_err();
        assert!(timed_out(kept.error) && kept.buffer.is_none());
        assert!(fs.take_buffer().is_none());
        let other = Buffer::new(own, allocator, 64).unwrap();
        let kept = data.write_buffer(other, 64).unwrap_err();
        let other = kept.buffer.expect("it was not lent");
        let third = Supervisor::start(&system, root.path(), None, "");
        assert_eq!(fs.settle(TIMEOUT).unwrap(), Some(Ok(4096)));
        let kept = data.write_buffer(other, 64).unwrap_err();
        assert_eq!(
            kept.error,
            FileError::Errno(condor_fs::Errno::BUSY),
            "one is to be taken back"
        );
        assert!(fs.take_buffer().is_some());
        fs.set_timeout(TIMEOUT);
        data.write_buffer(kept.buffer.unwrap(), 64).unwrap();
        assert_eq!(
            std::fs::read(root.path().join("data")).unwrap().len(),
            4096 + 64
        );

        // Nobody has a file whose open was late: it is closed, not lost.
        data.close().unwrap();
        log.close().unwrap();
        drop(third);
        fs.set_timeout(SHORT);
        assert!(
            fs.open("late", OpenOptions::new().write().exclusive())
                .is_err_and(timed_out)
        );
        let _fourth = Supervisor::start(&system, root.path(), None, "");
        fs.set_timeout(TIMEOUT);
        let read = OpenOptions::new().read();
        let all: Vec<_> = (0..crate::support::FILES)
            .map(|_| fs.open("late", read).unwrap())
            .collect();
        assert_eq!(all.len(), crate::support::FILES);
    });
}

#[test]
fn a_new_client_ends_what_the_former_left_open() {
    let root = disk();
    let system = system();
    let _supervisor = Supervisor::start(&system, root.path(), None, "");
    let own = root.path().join(".condor-fs");
    let left = || std::fs::read_dir(&own).unwrap().count();
    with_client(&system, CLIENT, |fs, _, _, _| {
        let file = fs.open("f", OpenOptions::new().write().create()).unwrap();
        fs.unlink("f").unwrap();
        assert_eq!(left(), 3, "lock, journal, and the file that is open");
        drop(file);
    });
    with_client(&system, crate::support::OTHER, |_, _, _, _| {
        assert_eq!(left(), 3, "not its own");
    });
    with_client(&system, CLIENT, |_, _, _, _| {
        assert_eq!(left(), 2);
    });
}
