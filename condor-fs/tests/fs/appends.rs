//! What clients and programs of the host append to the same file at the same time is all there, once.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::support::{BY_HOST, CLIENT, Supervisor, disk, system, with_client};
use condor_fs::OpenOptions;
use condor_fs::server::Step;
use condor_fs::wire::Operation;

const APPEND: OpenOptions = OpenOptions::new().append();

/// A program of the host appends at a step of the second append of three; the server dies then, or not.
#[test]
fn what_the_host_appends_meanwhile_is_kept() {
    let ours = ["one ", "two ", "three "];
    for options in ["host-appends spare", "host-appends"] {
        for step in [
            Step::Taken,
            Step::Begun,
            Step::Staged,
            Step::Part,
            Step::Acted,
            Step::Recorded,
        ] {
            for unlinked in [false, true] {
                let root = disk();
                let path = root.path().join("log");
                std::fs::write(&path, b"").unwrap();
                let host = std::fs::File::open(&path).unwrap();
                let system = system();
                let kill = Some((Operation::Append, step, 2));
                let supervisor = Supervisor::start(&system, root.path(), kill, options);
                with_client(&system, CLIENT, |fs, _, _, _| {
                    let mut log = fs.open("log", APPEND).unwrap();
                    if unlinked {
                        // It goes on under the server's own name; the host finds it by another one.
                        std::fs::hard_link(&path, root.path().join("other")).unwrap();
                        fs.unlink("log").unwrap();
                        std::fs::rename(root.path().join("other"), &path).unwrap();
                    }
                    for line in ours {
                        assert_eq!(log.write(line.as_bytes()), Ok(line.len()));
                    }
                });
                let deaths = u32::from(options == "host-appends");
                assert_eq!(supervisor.deaths(), deaths);
                let found = std::io::read_to_string(&host).unwrap();
                let by_host = std::str::from_utf8(BY_HOST).unwrap();
                let at = format!("{options}, {step:?}: {found:?}");
                assert_eq!(found.matches(by_host).count(), 1, "{at}");
                assert_eq!(found.replace(by_host, ""), ours.concat(), "{at}");
            }
        }
    }
}

#[test]
fn both_append_as_fast_as_they_can_over_deaths_of_the_server() {
    const LINES: u32 = 1000;
    let root = disk();
    let path = root.path().join("log");
    let mut host = std::fs::File::options()
        .append(true)
        .create(true)
        .open(&path)
        .unwrap();
    let system = system();
    let supervisor = Supervisor::start(&system, root.path(), None, "");
    let stop = AtomicBool::new(false);
    let by_host = std::thread::scope(|threads| {
        let host = threads.spawn(|| {
            let mut lines = 0;
            while !stop.load(Ordering::Relaxed) {
                // In one call.
                host.write_all(format!("host {lines}\n").as_bytes())
                    .unwrap();
                lines += 1;
            }
            lines
        });
        with_client(&system, CLIENT, |fs, _, _, _| {
            let mut log = fs.open("log", APPEND).unwrap();
            for n in 0..LINES {
                let line = format!("ours {n}\n");
                assert_eq!(log.write(line.as_bytes()), Ok(line.len()));
                if n % 100 == 50 {
                    supervisor.kill();
                }
            }
        });
        stop.store(true, Ordering::Relaxed);
        host.join().unwrap()
    });
    let text = std::fs::read_to_string(&path).unwrap();
    for (who, lines) in [("ours", LINES), ("host", by_host)] {
        let mut found = text.lines().filter_map(|line| line.strip_prefix(who));
        assert!(
            (0..lines).all(|n| found.next() == Some(&format!(" {n}"))),
            "{who}"
        );
        assert_eq!(found.next(), None, "{who}");
    }
    assert_eq!(text.lines().count() as u32, LINES + by_host);
}

/// What is only open for writing, or not to be read at all, is appended to like all else.
#[test]
fn a_file_that_cannot_be_read_is_appended_to_once() {
    use std::os::unix::fs::PermissionsExt;
    let root = disk();
    let path = root.path().join("log");
    std::fs::write(&path, b"").unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o222)).unwrap();
    if crate::support::is_root() {
        std::os::unix::fs::chown(root.path(), Some(crate::support::NOBODY), None).unwrap();
    }
    let system = system();
    let kill = Some((Operation::Append, Step::Acted, 1));
    let supervisor = Supervisor::start(&system, root.path(), kill, "nobody");
    with_client(&system, CLIENT, |fs, _, _, _| {
        assert_eq!(fs.open("log", APPEND).unwrap().write(b"once"), Ok(4));
    });
    assert_eq!(supervisor.deaths(), 1);
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o600)).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), b"once");
}
