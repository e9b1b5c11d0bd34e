//! The program `condor-fs-server`, with its options, and a client of another process.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Output};

use crate::support::AnyFs;
use condor_fs::{Errno, FileError, OpenOptions};
use condor_mbox::Processor;
use condor_mbox::linux::LinuxSystem;

const BYTES: u32 = 32 * 1024;
const PROGRAM: &str = env!("CARGO_BIN_EXE_condor-fs-server");

/// Killed at the end of a test, as it may be at any time.
struct Server(Child);

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(system: &str, root: &Path, options: &[&str]) -> Server {
    let mut command = Command::new(PROGRAM);
    command.args(["--system", system, "--bytes", &BYTES.to_string()]);
    // Its modes are less the umask, which is the same in every program here.
    Server(command.args(options).arg(root).spawn().unwrap())
}

fn with_client<R>(
    system: &LinuxSystem<32>,
    number: u8,
    program: impl FnOnce(AnyFs<'_, '_, 32, 2>) -> R,
) -> R {
    let number = Processor(number);
    crate::support::try_client(system, number, (100, 1024), |files, _, _, _| program(files))
}

fn fails<T>(outcome: Result<T, FileError>, errno: Errno) {
    assert_eq!(outcome.err(), Some(FileError::Errno(errno)));
}

#[test]
fn its_options_are_those_of_the_library() {
    let name = format!("condor-fs-program-{}", std::process::id());
    let system = LinuxSystem::<32>::named(&name, BYTES).unwrap();
    let disk = crate::support::disk();
    let at = |path: &str| disk.path().join(path);
    std::fs::write(at("given"), b"given").unwrap();
    let options = [
        "--read-only-for",
        "2",
        "--refuse",
        "3",
        "--refuse",
        "4",
        "--file-mode",
        "600",
        "--directory-mode",
        "700",
        "--max-file-bytes",
        "1000",
        "--quota-bytes",
        "5101",
    ];
    let server = start(&name, disk.path(), &options);
    let write = OpenOptions::new().write().create();
    with_client(&system, 1, |files| {
        let files = files.unwrap();
        let mut file = files.open("file", write).unwrap();
        assert_eq!(file.write(&[1; 1000]), Ok(1000));
        fails(file.write(b"1"), Errno::FBIG);
        files.make_directory("directory").unwrap();
        // 5 bytes are the other file's, and 1024 count each of the four names.
        files
            .open("other", write.exclusive())
            .unwrap()
            .close()
            .unwrap();
        fails(files.make_directory("another"), Errno::DQUOT);
    });
    for (path, mode) in [("file", 0o600), ("other", 0o600), ("directory", 0o700)] {
        let found = std::fs::metadata(at(path)).unwrap().permissions().mode();
        assert_eq!(found & 0o777, mode, "{path}");
    }
    with_client(&system, 2, |files| {
        let files = files.unwrap();
        fails(files.open("file", write), Errno::ROFS);
        fails(files.unlink("given"), Errno::ROFS);
        let mut bytes = [0; 8];
        let mut given = files.open("given", OpenOptions::new().read()).unwrap();
        assert_eq!(given.read(&mut bytes), Ok(5));
    });
    for refused in [3, 4] {
        with_client(&system, refused, |files| fails(files, Errno::ACCES));
    }
    drop(server);
    let server = start(&name, disk.path(), &["--read-only"]);
    with_client(&system, 1, |files| {
        fails(files.unwrap().unlink("given"), Errno::ROFS);
    });
    assert_eq!(std::fs::read(at("given")).unwrap(), b"given");
    drop(server);
    // A child of another test may still hold a lock, between `fork` and `exec`.
    system.remove_within(crate::support::TIMEOUT).unwrap();
}

#[test]
fn it_says_what_is_wrong() {
    let run =
        |arguments: &[&str]| -> Output { Command::new(PROGRAM).args(arguments).output().unwrap() };
    for arguments in [
        &[][..],
        &["--system", "x", "--bytes", "many", "/"],
        &[
            "--system",
            "x",
            "--bytes",
            "4096",
            "--file-mode",
            "888",
            "/",
        ],
        &["--system", "x", "--bytes", "4096", "--refuse", "/"],
    ] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(
            String::from_utf8(output.stderr)
                .unwrap()
                .starts_with("usage: ")
        );
    }
    let output = run(&["--system", "x", "--bytes", "4096", "/none/at/all"]);
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("/none/at/all"), "{text}");
}

#[test]
fn help_that_is_asked_for_is_no_mistake() {
    for help in ["--help", "-h"] {
        let Output {
            status,
            stdout,
            stderr,
        } = Command::new(PROGRAM).arg(help).output().unwrap();
        assert!(status.success() && stderr.is_empty());
        let text = String::from_utf8(stdout).unwrap();
        assert!(text.contains("condor-fs-server"), "{text}");
    }
}
