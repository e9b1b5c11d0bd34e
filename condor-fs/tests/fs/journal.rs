//! Nothing is begun that the next server would not know of.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::{disk, with_server};
use condor_fs::server::{FileServer, ServerError, ServerOptions};
use condor_fs::{Errno, FileError, OpenOptions};

#[test]
fn without_a_journal_nothing_is_begun() {
    let root = disk();
    let at = |path: &str| root.path().join(path);
    std::fs::write(at("f"), b"....").unwrap();
    with_server(root.path(), "", |fs, _, _, _| {
        let mut file = fs.open("f", OpenOptions::new().append()).unwrap();
        let journal = at(".condor-fs/journal");
        let gone = std::fs::File::options().write(true).open(&journal);
        gone.unwrap().set_len(0).unwrap();
        // The next operation finds the file again.
        assert_eq!(file.write(b"1"), Ok(1));
        let gone = std::fs::File::options().write(true).open(&journal);
        gone.unwrap().set_len(0).unwrap();
        std::fs::remove_file(&journal).unwrap();
        std::fs::create_dir(&journal).unwrap();
        let refused = FileError::Errno(Errno::ISDIR);
        assert_eq!(file.write(b"2"), Err(refused));
        assert_eq!(fs.unlink("f"), Err(refused));
        std::fs::remove_dir(&journal).unwrap();
        assert_eq!(file.write(b"3"), Ok(1));
    });
    assert_eq!(std::fs::read(at("f")).unwrap(), b"....13");
}

const FULL: &str = "CONDOR_FS_TEST_FULL";

/// Is run with a disk of its own by the test below.
#[test]
fn on_a_full_disk() {
    let Ok(root) = std::env::var(FULL) else {
        return;
    };
    let root = Path::new(&root);
    // Everything is there but the journal.
    drop(FileServer::new(root, ServerOptions::default()).unwrap());
    std::fs::remove_file(root.join(".condor-fs/journal")).unwrap();
    let mut filler = std::fs::File::create(root.join("filler")).unwrap();
    let full = loop {
        if let Err(error) = filler.write_all(&[1; 4096]) {
            break error.kind();
        }
    };
    assert_eq!(full, ErrorKind::StorageFull);
    let refused = FileServer::new(root, ServerOptions::default())
        .err()
        .unwrap();
    let text = refused.to_string();
    assert!(
        text.contains("journal") && text.contains("No space left"),
        "{text}"
    );
    let ServerError::Journal { path, source } = refused else {
        panic!("{refused:?}");
    };
    assert_eq!(path, root.join(".condor-fs/journal"));
    assert_eq!(source.kind(), ErrorKind::StorageFull);
    drop(filler);
    std::fs::remove_file(root.join("filler")).unwrap();
    drop(FileServer::new(root, ServerOptions::default()).unwrap());
}

#[test]
fn a_server_does_not_start_on_a_full_disk() {
    let unshare = |command: &str| {
        let mut unshare = Command::new("unshare");
        unshare.args(["--map-root-user", "--mount", "sh", "-ec", command]);
        unshare
    };
    let root = disk();
    let mount = "mount -t tmpfs -o size=64k condor \"$CONDOR_FS_TEST_FULL\"";
    let mut probe = unshare(mount);
    probe.env(FULL, root.path()).stderr(Stdio::null());
    if !probe.status().is_ok_and(|status| status.success()) {
        println!("SKIPPED: no filesystem may be mounted here");
        return;
    }
    let output = unshare(&format!(
        "{mount}; exec \"$0\" journal::on_a_full_disk --exact"
    ))
    .arg(std::env::current_exe().unwrap())
    .env(FULL, root.path())
    .output()
    .unwrap();
    assert!(output.status.success(), "{output:?}");
}
