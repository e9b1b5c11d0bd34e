//! Where a system lies: no peer, no working directory and no program of another size moves it.
#![cfg(feature = "linux")]

use std::fs::{self, Permissions};
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown, symlink};
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::linux_child::{Actor, part, say};
use condor_mbox::Processor;
use condor_mbox::layout::{BELL_BYTES, mail_bytes};
use condor_mbox::linux::{FileKind, LinuxSystem, Memory, ObjectPositions, SystemError};

const USER_BYTES: u32 = 64;
const FIRST: Processor = Processor(0);

fn set_mode(path: impl AsRef<Path>, mode: u32) {
    fs::set_permissions(path, Permissions::from_mode(mode)).expect("it is ours");
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).expect("it is there").mode() & 0o7777
}

fn names(directory: &Path) -> Vec<String> {
    let entries = fs::read_dir(directory).expect("it can be listed");
    let name = |entry: fs::DirEntry| entry.file_name().to_string_lossy().into_owned();
    let mut names: Vec<_> = entries
        .map(|entry| name(entry.expect("it can be listed")))
        .collect();
    names.sort();
    names
}

fn is_a_link(error: &SystemError, at: &Path) -> bool {
    matches!(error, SystemError::WrongKind { path, found: FileKind::Symlink, .. } if path == at)
}

/// Removes a system, once no child of another test, on its way to its own program, has its files.
fn remove<const N: usize>(system: &LinuxSystem<N>) -> Result<(), SystemError> {
    system.clone().remove_within(Duration::from_secs(100))
}

/// What anybody can put into `/dev/shm` before the system is there.
#[test]
fn a_link_in_the_place_of_a_named_system_is_not_followed() {
    let kept = tempfile::tempdir().expect("a temporary directory");
    let name = format!("test-link-{}", std::process::id());
    let path = Path::new("/dev/shm").join(format!("condor-{name}"));
    symlink(kept.path(), &path).expect("a link");
    let refused =
        LinuxSystem::<1>::named(&name, USER_BYTES).map(|system| system.claim(FIRST).is_ok());
    let at = LinuxSystem::<1>::at(&path, USER_BYTES).map(drop);
    fs::remove_file(&path).expect("it is ours");
    let error = refused.expect_err("it is a link");
    assert!(is_a_link(&error, &path), "{error}");
    let error = at.expect_err("it is a link");
    assert!(is_a_link(&error, &path), "{error}");
    assert_eq!(names(kept.path()), [""; 0]);
}

/// A link where the directory goes when it is removed leads nowhere else, either.
#[test]
fn a_link_in_the_place_of_a_grave_is_not_followed() {
    let kept = tempfile::tempdir().expect("a temporary directory");
    let path = kept.path().join("system");
    let other = kept.path().join("other");
    let system = LinuxSystem::<1>::at(&path, USER_BYTES).expect("it is created");
    drop(system.claim(FIRST).expect("it is free"));
    fs::create_dir(&other).expect("a directory");
    fs::write(other.join("0.mail"), "").expect("a file");
    symlink(&other, kept.path().join("system.removed")).expect("a link");
    remove(&system).expect_err("its place is taken");
    assert_eq!(names(&other), ["0.mail"]);
    fs::remove_file(kept.path().join("system.removed")).expect("it is ours");
    remove(&system).expect("nobody has it");
    assert_eq!(names(kept.path()), ["other"]);
}

#[test]
fn a_relative_path_is_the_same_system_in_a_child_elsewhere() {
    let kept = tempfile::tempdir().expect("a temporary directory");
    let elsewhere = tempfile::tempdir().expect("a temporary directory");
    let own = std::env::current_dir().expect("it is there");
    let up = own.components().skip(1).map(|_| "..");
    let from_root = kept.path().strip_prefix("/").expect("it is absolute");
    let relative: PathBuf = up.collect::<PathBuf>().join(from_root).join("system");
    let system = LinuxSystem::<1>::at(&relative, USER_BYTES).expect("it is created");
    let _claim = system.claim(FIRST).expect("it is free");
    let mut child = Actor::start("place::the_child_elsewhere", "elsewhere", |command| {
        system.pass_to(command).current_dir(elsewhere.path());
    });
    let heard = child.hear().expect("it says what it found");
    assert!(heard.contains("is taken by process"), "{heard}");
    assert_eq!(names(elsewhere.path()), [""; 0]);
    let mut child = Actor::start("place::the_child_elsewhere", "elsewhere", |command| {
        command.env("CONDOR_SYSTEM", "1 64 at system");
        command.current_dir(elsewhere.path());
    });
    let heard = child.hear().expect("it says what it found");
    assert!(heard.contains("not absolute"), "{heard}");
}

/// What the child does; nothing in the parent.
#[test]
fn the_child_elsewhere() {
    if part().as_deref() == Some("elsewhere") {
        let claim = LinuxSystem::<1>::inherited().and_then(|system| system.claim(FIRST));
        say(&claim.map_or_else(|error| error.to_string(), |_| "claimed".into()));
    }
}

/// A program that was built for more processors, or for more bytes.
#[test]
fn a_program_of_another_size_leaves_nothing_behind() {
    let kept = tempfile::tempdir().expect("a temporary directory");
    let path = kept.path().join("system");
    let system = LinuxSystem::<2>::at(&path, USER_BYTES).expect("it is created");
    drop(system.claim(FIRST).expect("it is free"));
    let files = names(&path);
    let claim = |number| {
        let larger = LinuxSystem::<4>::at(&path, USER_BYTES)?;
        larger.claim(Processor(number)).map(drop)
    };
    for number in 0..4 {
        let error = claim(number).expect_err("there are two").to_string();
        assert!(error.contains("processors is [2], expected 4"), "{error}");
    }
    let error = LinuxSystem::<2>::at(&path, USER_BYTES + 4).expect_err("there are fewer bytes");
    let expected = "data-bytes is [64], expected 68";
    assert!(error.to_string().contains(expected), "{error}");
    assert_eq!(names(&path), files);
    remove(&system).expect("all files are its own");
    assert_eq!(names(kept.path()), [""; 0]);
}

/// Which file a process writes is not for any peer of its directory to say.
#[test]
fn a_memory_that_a_stranger_names_is_refused() {
    let kept = tempfile::tempdir().expect("a temporary directory");
    let (path, ram) = (kept.path().join("system"), kept.path().join("ram"));
    let (mail, data) = (mail_bytes(1), BELL_BYTES + USER_BYTES);
    fs::write(&ram, vec![0; (mail + data) as usize]).expect("a file");
    let run = |offset: u32| ObjectPositions {
        offset: offset.into(),
        stride: 4,
    };
    let memory = Memory {
        file: ram,
        mail: run(0),
        data: run(mail),
    };
    LinuxSystem::<1>::in_memory(&path, USER_BYTES, &memory).expect("it is created");
    let said = path.join("system");
    assert_eq!(mode(&said), 0o400);
    set_mode(&said, 0o420);
    let error = LinuxSystem::<1>::at(&path, USER_BYTES).expect_err("others may write it");
    assert!(
        error
            .to_string()
            .contains("its mode 420 lets others write it"),
        "{error}"
    );
    set_mode(&said, 0o400);
    LinuxSystem::<1>::at(&path, USER_BYTES).expect("it is ours");
    // Only root can make it somebody else's.
    if rustix::process::geteuid().is_root() {
        chown(&said, Some(1), None).expect("root may");
        let error = LinuxSystem::<1>::at(&path, USER_BYTES).expect_err("it is a stranger's");
        assert!(
            matches!(error, SystemError::WrongOwner { found: 1, .. }),
            "{error}"
        );
        // A directory of the stranger's is his to describe.
        chown(&path, Some(1), None).expect("root may");
        LinuxSystem::<1>::at(&path, USER_BYTES).expect("it is its owner's");
    }
}
