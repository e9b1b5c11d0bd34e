//! Numbers, files and families of `LinuxSystem`.
#![cfg(feature = "linux")]

use std::fs;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Barrier, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use crate::linux_child::{Actor, part, say, wait_for_parent};
use condor_mbox::layout::{BELL_BYTES, header, mail_bytes};
use condor_mbox::linux::{
    Claim, FileKind, LinuxSystem, Memory, ObjectPositions, SystemError, WindowAccess,
};
use condor_mbox::{Doorbell, Evidence, LoadOrder, MemoryWindow, Processor, StoreOrder};
use tempfile::TempDir;

const USER_BYTES: u32 = 256;
const FIRST: Processor = Processor(0);
const SECOND: Processor = Processor(1);
const PATIENCE: Duration = Duration::from_secs(100);

fn directory() -> (TempDir, LinuxSystem<2>) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let system =
        LinuxSystem::at(directory.path().join("system"), USER_BYTES).expect("it is created");
    (directory, system)
}

fn store<const N: usize>(claim: &Claim<N>, owner: usize, offset: u32, value: u32) {
    let data = &claim.windows()[owner].data;
    data.store(BELL_BYTES + offset, value, StoreOrder::Release)
        .expect("it is inside");
}

fn load<const N: usize>(claim: &Claim<N>, owner: usize, offset: u32) -> u32 {
    let data = &claim.windows()[owner].data;
    data.load(BELL_BYTES + offset, LoadOrder::Acquire)
        .expect("it is inside")
}

/// Waits for what follows from a drop in this process.
///
/// Other tests of this program start children meanwhile; between `fork` and `exec` a child holds
/// what this process holds.
fn until(is_true: impl Fn() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !is_true() {
        assert!(Instant::now() < deadline, "it does not become true");
        thread::yield_now();
    }
}

/// Bytes of the memory in one file.
const MEMORY_BYTES: u64 = 1 << 18;

/// A memory in `directory`, with the objects from `offset` on, which begins a page or not.
fn memory(directory: &Path, offset: u64) -> Memory {
    let file = directory.join("ram");
    let ram = fs::File::create(&file).expect("a file");
    ram.set_len(MEMORY_BYTES).expect("it has room");
    Memory {
        file,
        mail: ObjectPositions {
            offset,
            stride: 1 << 15,
        },
        data: ObjectPositions {
            offset: offset + (1 << 16),
            stride: u64::from(BELL_BYTES + USER_BYTES),
        },
    }
}

fn in_memory(offset: u64) -> (TempDir, LinuxSystem<2>) {
    let directory = tempfile::tempdir().expect("a temporary directory");
    let memory = memory(directory.path(), offset);
    let path = directory.path().join("system");
    LinuxSystem::<2>::in_memory(&path, USER_BYTES, &memory).expect("it is created");
    // Nobody else is told where the memory is.
    let system = LinuxSystem::at(path, USER_BYTES).expect("it is found");
    (directory, system)
}

/// Every kind of place, with what must be kept meanwhile.
fn places() -> Vec<(Option<TempDir>, LinuxSystem<2>)> {
    let files = [directory(), in_memory(0x4000), in_memory(0x1234)];
    let files = files.map(|(kept, system)| (Some(kept), system));
    let family = LinuxSystem::family(USER_BYTES).expect("it is created");
    files.into_iter().chain([(None, family)]).collect()
}

#[test]
fn claimants_share_their_memory() {
    for (_kept, system) in places() {
        let first = system.claim(FIRST).expect("it is free");
        let second = system.claim(SECOND).expect("it is free");
        assert_eq!((first.number(), second.number()), (FIRST, SECOND));
        for (owner, value) in [(0, 5), (1, 6)] {
            store(&first, owner, 100, value);
            assert_eq!(load(&second, owner, 100), value);
        }
        let [own, peer] = first.windows();
        assert_eq!(own.mail.access(), WindowAccess::ReadWrite);
        assert_eq!(peer.mail.access(), WindowAccess::ReadOnly);
        assert_eq!(own.mail.size(), mail_bytes(2));
        assert_eq!(peer.data.size(), BELL_BYTES + USER_BYTES);
        own.mail
            .store(header::INCARNATION, 9, StoreOrder::Release)
            .expect("it is our own");
        let seen = second.windows()[0]
            .mail
            .load(header::INCARNATION, LoadOrder::Acquire);
        assert_eq!(seen.expect("it is inside"), 9);
    }
}

#[test]
fn a_number_is_held_as_long_as_its_mail_can_be_written() {
    for (_kept, system) in places() {
        let watcher = system.claim(SECOND).expect("it is free");
        let holder = system.claim(FIRST).expect("it is free");
        let evidence = || watcher.doorbell().evidence(FIRST);
        let mail = &holder.windows()[0].mail;
        mail.store(header::PROCESS_ID, 1234, StoreOrder::Relaxed)
            .expect("it is inside");
        let error = system
            .claim_within(FIRST, Duration::ZERO)
            .expect_err("it is taken");
        assert!(
            matches!(
                error,
                SystemError::NumberTaken {
                    number: FIRST,
                    process_id: 1234
                }
            ),
            "{error}"
        );
        let (windows, doorbell) = holder.into_parts();
        drop(doorbell);
        let [own, peer] = windows;
        drop(peer);
        assert_eq!(evidence(), Evidence::Alive);
        drop(own);
        until(|| evidence() == Evidence::Dead);
        let holder = system.claim(FIRST).expect("it is free again");
        let bell = holder.doorbell().pollable();
        drop(holder);
        assert_eq!(evidence(), Evidence::Alive);
        drop(bell);
        until(|| evidence() == Evidence::Dead);
        assert_eq!(watcher.doorbell().evidence(SECOND), Evidence::Alive);
        assert_eq!(watcher.doorbell().evidence(Processor(2)), Evidence::Unknown);
    }
}

#[test]
fn virtual_processors_get_the_highest_free_number() {
    for (_kept, system) in places() {
        let second = system.claim_any().expect("all are free");
        let first = system.claim_any().expect("one is free");
        assert_eq!((first.number(), second.number()), (FIRST, SECOND));
        let error = system.claim_any().expect_err("none is free");
        assert!(
            matches!(error, SystemError::NoFreeNumber { processors: 2 }),
            "{error}"
        );
        drop(second);
        let again = system.claim_any().expect("one is free again");
        assert_eq!(again.number(), SECOND);
        let error = system.claim(Processor(2)).expect_err("there is none");
        assert!(
            matches!(error, SystemError::NoSuchProcessor { processors: 2, .. }),
            "{error}"
        );
    }
}

#[test]
fn a_killed_holder_is_dead_and_its_number_free() {
    for (_kept, system) in places() {
        let watcher = system.claim(FIRST).expect("it is free");
        for _ in 0..10 {
            let mut holder = holder_of(&system);
            let error = system.claim_within(SECOND, Duration::ZERO);
            let error = error.expect_err("it is taken");
            let SystemError::NumberTaken {
                number: SECOND,
                process_id,
            } = error
            else {
                panic!("{error}");
            };
            assert_eq!(process_id, holder.id());
            assert_eq!(watcher.doorbell().evidence(SECOND), Evidence::Alive);
            assert_eq!(load(&watcher, 0, 8), holder.id());
            holder.kill();
            assert_eq!(watcher.doorbell().evidence(SECOND), Evidence::Dead);
            drop(system.claim(SECOND).expect("it is free at once"));
            until(|| watcher.doorbell().evidence(SECOND) == Evidence::Dead);
        }
    }
}

#[test]
fn everything_works_after_all_were_killed() {
    let (_kept, system) = directory();
    let mut holder = holder_of(&system);
    holder.kill();
    let first = system.claim(FIRST).expect("it is free");
    assert_eq!(load(&first, 0, 8), holder.id(), "the memory is the same");
    system.claim(SECOND).expect("it is free");
}

#[test]
fn grandchildren_can_take_part() {
    for (_kept, system) in places() {
        let own = system.claim(FIRST).expect("it is free");
        let mut child = Actor::start("system::the_parts", "parent of a holder", |command| {
            system.pass_to(command);
        });
        assert_eq!(child.hear().as_deref(), Some("held"));
        assert_eq!(own.doorbell().evidence(SECOND), Evidence::Alive);
    }
}

#[test]
fn a_child_that_was_passed_nothing_holds_nothing() {
    let system = LinuxSystem::<2>::family(USER_BYTES).expect("it is created");
    let watcher = system.claim(FIRST).expect("it is free");
    let holder = system.claim(SECOND).expect("it is free");
    let mut child = Actor::start("system::the_parts", "bystander", |_| {});
    assert_eq!(child.hear().as_deref(), Some("ready"));
    drop(holder);
    until(|| watcher.doorbell().evidence(SECOND) == Evidence::Dead);
}

#[test]
fn descriptions_that_are_wrong_are_refused() {
    let cases = [
        ("", "number"),
        ("2", "ends too early"),
        ("3 256 at /nowhere", "another number of processors"),
        ("2 x at /nowhere", "its data size is not a number"),
        ("2 256", "ends too early"),
        ("2 256 somewhere else", "neither `at` nor `family`"),
        ("2 256 family 1 2 3", "three descriptors"),
        ("2 256 family 1 2 3 4 5 -1", "three descriptors"),
        ("2 256 family 900 901 902 903 904 905", "cannot open"),
        ("2 254 family 1 2 3 4 5 6", "must be a multiple of 4"),
        ("2 256 at /nowhere/at/all", "cannot create"),
    ];
    for (description, expected) in cases {
        let mut child = Actor::start("system::the_parts", "inheritor", |command| {
            command.env("CONDOR_SYSTEM", description);
        });
        let heard = child.hear().expect("it says what it found");
        assert!(heard.contains(expected), "{description:?}: {heard}");
    }
}

#[test]
fn creators_may_race() {
    for _ in 0..20 {
        let directory = tempfile::tempdir().expect("a temporary directory");
        let start = Barrier::new(8);
        let claims: Vec<Claim<8>> = thread::scope(|scope| {
            let creator = |number: u8| {
                let (start, path) = (&start, directory.path().join("system"));
                scope.spawn(move || {
                    start.wait();
                    let system = LinuxSystem::at(path, USER_BYTES).expect("it is created once");
                    let claim = system.claim(Processor(number)).expect("it is free");
                    store(&claim, 0, 4 * u32::from(number), 1 + u32::from(number));
                    claim
                })
            };
            let creators: Vec<_> = (0..8).map(creator).collect();
            creators
                .into_iter()
                .map(|thread| thread.join().expect("no panic"))
                .collect()
        });
        for claim in &claims {
            for number in 0..8 {
                assert_eq!(load(claim, 0, 4 * number), 1 + number);
            }
        }
    }
}

#[test]
fn one_of_many_gets_the_number() {
    for (_kept, system) in places() {
        for _ in 0..20 {
            // Nobody gets it while a child of another test has the descriptor of the last holder.
            until(|| {
                let start = Barrier::new(4);
                let taken: usize = thread::scope(|scope| {
                    let claimants: [_; 4] = std::array::from_fn(|_| {
                        scope.spawn(|| {
                            start.wait();
                            let claim = system.claim_within(FIRST, Duration::ZERO);
                            start.wait();
                            usize::from(claim.is_ok())
                        })
                    });
                    claimants
                        .into_iter()
                        .map(|thread| thread.join().expect("no panic"))
                        .sum()
                });
                assert!(taken <= 1, "{taken} of 4 have it");
                taken == 1
            });
        }
    }
}

/// Why the first number cannot be had.
fn refusal<const N: usize>(system: &LinuxSystem<N>) -> SystemError {
    let result = system.claim_within(FIRST, PATIENCE).map(drop);
    result.expect_err("the files are of another size")
}

#[test]
fn a_file_of_another_size_is_refused() {
    let (kept, system) = directory();
    drop(system.claim(FIRST).expect("it is free"));
    let path = kept.path().join("system/0.data");
    let resize = |bytes| {
        let file = fs::File::options().write(true).open(&path);
        file.and_then(|file| file.set_len(bytes))
            .expect("it is ours");
    };
    let size = u64::from(BELL_BYTES + USER_BYTES);
    resize(size - 4);
    let error = refusal(&system);
    let SystemError::WrongSize {
        path: wrong,
        found,
        expected,
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!((wrong, found, expected), (path.clone(), size - 4, size));
    resize(size);
    system
        .claim_within(FIRST, PATIENCE)
        .expect("it is free again");
}

#[test]
fn names_of_the_wrong_kind_are_refused() {
    type Make = fn(&Path);
    let cases: [(&str, Make, FileKind, FileKind); 5] = [
        (
            "0.mail",
            |path| fs::create_dir(path).expect("a directory"),
            FileKind::Directory,
            FileKind::File,
        ),
        (
            "1.data",
            |path| symlink("/dev/null", path).expect("a link"),
            FileKind::Symlink,
            FileKind::File,
        ),
        ("1.mail", make_fifo, FileKind::Fifo, FileKind::File),
        (
            "0.bell",
            |path| fs::write(path, "").expect("a file"),
            FileKind::File,
            FileKind::Fifo,
        ),
        (
            "1.bell",
            |path| symlink("0.bell", path).expect("a link"),
            FileKind::Symlink,
            FileKind::Fifo,
        ),
    ];
    for (name, make, is, should_be) in cases {
        let (kept, system) = directory();
        let bad = kept.path().join("system").join(name);
        make(&bad);
        let error = system.claim(FIRST).expect_err("it is refused");
        let SystemError::WrongKind {
            path,
            found,
            expected,
        } = error
        else {
            panic!("{name}: {error}");
        };
        assert_eq!((path, found, expected), (bad, is, should_be));
    }
    let (kept, _) = directory();
    let file = kept.path().join("file");
    fs::write(&file, "").expect("a file");
    let error = LinuxSystem::<2>::at(&file, USER_BYTES).expect_err("it is no directory");
    assert!(
        matches!(
            error,
            SystemError::WrongKind {
                found: FileKind::File,
                ..
            }
        ),
        "{error}"
    );
}

fn make_fifo(path: &Path) {
    let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
    rustix::fs::mkfifoat(rustix::fs::CWD, path, mode).expect("a FIFO");
}

#[test]
fn bad_names_and_sizes_are_refused() {
    for name in ["", "a/b", "../x", "a\0b", &"x".repeat(241)] {
        let error = LinuxSystem::<2>::named(name, USER_BYTES).expect_err("it is refused");
        assert!(matches!(error, SystemError::BadName { .. }), "{error}");
    }
    for user_bytes in [1, 4098, u32::MAX, u32::MAX - 3] {
        let error = LinuxSystem::<2>::family(user_bytes).expect_err("it is refused");
        assert!(matches!(error, SystemError::BadDataSize { .. }), "{error}");
    }
}

#[test]
fn a_named_system_is_its_users_alone() {
    let name = format!("test-{}", std::process::id());
    let path = Path::new("/dev/shm").join(format!("condor-{name}"));
    let system = LinuxSystem::<2>::named(&name, USER_BYTES).expect("it is created");
    let claim = system.claim(FIRST).expect("it is free");
    let mode = |path: &Path| {
        fs::metadata(path)
            .expect("it is there")
            .permissions()
            .mode()
            & 0o777
    };
    assert_eq!(mode(&path), 0o700);
    for file in ["0.mail", "1.data", "0.bell"] {
        assert_eq!(mode(&path.join(file)), 0o600, "{file}");
    }
    drop(claim);
    let user = fs::metadata(&path).expect("it is there").uid();
    if user == 0 {
        // Only root can make the directory somebody else's.
        std::os::unix::fs::chown(&path, Some(1), None).expect("root may");
        let error = LinuxSystem::<2>::named(&name, USER_BYTES).expect_err("it is another user's");
        assert!(
            matches!(
                error,
                SystemError::WrongOwner {
                    found: 1,
                    expected: 0,
                    ..
                }
            ),
            "{error}"
        );
        std::os::unix::fs::chown(&path, Some(0), None).expect("root may");
    }
    system
        .clone()
        .remove_within(PATIENCE)
        .expect("nobody has it");
    assert!(!path.exists());
}

#[test]
fn files_get_the_permissions_of_their_directory() {
    let (kept, system) = directory();
    let path = kept.path().join("system");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o770)).expect("it is ours");
    let _claim = system.claim(FIRST).expect("it is free");
    for file in ["0.mail", "1.data", "0.bell"] {
        let mode = fs::metadata(path.join(file))
            .expect("it is there")
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o660, "{file}");
    }
}

#[test]
fn a_claim_waits_until_the_one_before_it_is_dropped() {
    let (_kept, system) = directory();
    let claim = system.claim(FIRST).expect("it is free");
    let refused = system.claim_within(FIRST, Duration::ZERO);
    let refused = refused.map(drop).expect_err("it is taken");
    assert!(
        matches!(refused, SystemError::NumberTaken { number: FIRST, .. }),
        "{refused}"
    );
    thread::scope(|scope| {
        let next = scope.spawn(|| system.claim_within(FIRST, PATIENCE).map(drop));
        let removed = scope.spawn(|| system.clone().remove_within(PATIENCE));
        drop(claim);
        next.join().expect("it ends").expect("it is free then");
        removed.join().expect("it ends").expect("it is free then");
    });
}

/// The descriptors of a file that this process has open, once more: as a child has them that another thread has
/// started, until it executes its program.
fn forked(path: &Path) -> Vec<OwnedFd> {
    let all = fs::read_dir("/proc/self/fd").expect("it can be listed");
    let all = all.map(|entry| entry.expect("it can be listed").path());
    let of_file = all.filter(|link| fs::read_link(link).is_ok_and(|target| target == path));
    let forked = of_file.map(|link| {
        let name = link.file_name().and_then(|name| name.to_str());
        let number = name.and_then(|name| name.parse().ok()).expect("a number");
        // SAFETY: whoever calls this function has the file open, and nobody else uses its directory.
        let open = unsafe { BorrowedFd::borrow_raw(number) };
        open.try_clone_to_owned().expect("there is room for it")
    });
    forked.collect()
}

/// Whether a thread of this process sleeps, or has ended.
fn sleeps(thread: rustix::thread::Pid) -> bool {
    let thread = thread.as_raw_nonzero();
    let stat = fs::read_to_string(format!("/proc/self/task/{thread}/stat"));
    stat.map_or(true, |stat| stat.contains(") S "))
}

#[test]
fn a_claim_waits_for_a_child_that_is_about_to_execute_its_program() {
    let (kept, system) = directory();
    let kept = kept.path().canonicalize().expect("it is there");
    let mail = kept.join("system/0.mail");
    // At once, unless this thread lets go too late.
    until(|| {
        let claim = system.claim_within(FIRST, PATIENCE).expect("it is free");
        let forked = forked(&mail);
        drop(claim);
        let refused = system.claim_within(FIRST, Duration::ZERO).map(drop);
        assert!(matches!(refused, Err(SystemError::NumberTaken { .. })));
        let (tell, told) = mpsc::channel();
        thread::scope(|scope| {
            let next = scope.spawn(|| {
                let tell = tell;
                tell.send(rustix::thread::gettid()).expect("it is heard");
                system.claim(FIRST).map(drop)
            });
            let thread = told.recv().expect("it is told");
            // Between two attempts.
            until(|| sleeps(thread));
            drop(forked);
            next.join().expect("it ends").is_ok()
        })
    });
}

#[test]
fn a_number_that_stays_taken_is_named_with_its_remedy() {
    let (_kept, system) = directory();
    let _claim = system.claim(FIRST).expect("it is free");
    let error = system.claim(FIRST).map(drop).expect_err("it is taken");
    let own = std::process::id();
    let expected =
        format!("processor 0 is taken by process {own}: end that process, or use another number");
    assert_eq!(error.to_string(), expected);
}

#[test]
fn a_system_in_use_is_not_removed() {
    let (kept, system) = directory();
    let path = kept.path().join("system");
    let claim = system.claim(SECOND).expect("it is free");
    let error = system.clone().remove_within(Duration::ZERO);
    let error = error.expect_err("it is in use");
    assert!(
        matches!(error, SystemError::NumberTaken { number: SECOND, .. }),
        "{error}"
    );
    drop(claim);
    fs::write(path.join("notes"), "").expect("a file");
    let error = system.clone().remove_within(PATIENCE);
    assert!(matches!(error, Err(SystemError::ForeignFile { .. })));
    assert!(path.join("1.mail").exists());
    fs::remove_file(path.join("notes")).expect("it is there");
    system
        .clone()
        .remove_within(PATIENCE)
        .expect("nobody has it");
    assert_eq!(
        fs::read_dir(kept.path()).expect("it can be listed").count(),
        0
    );
    system.claim(FIRST).expect("a new system begins");
}

/// Every object is where the memory is said to have it, and nowhere else.
#[test]
fn windows_lie_in_the_memory() {
    for offset in [0x4000_u64, 0x1234] {
        let (kept, system) = in_memory(offset);
        let first = system.claim(FIRST).expect("it is free");
        let second = system.claim(SECOND).expect("it is free");
        store(&second, 0, 16, 0x1234_5678);
        store(&first, 1, 20, 0x9abc_def0);
        let mail = &second.windows()[1].mail;
        mail.store(header::LAST_INCARNATION, 77, StoreOrder::Release)
            .expect("it is our own");
        let bytes = fs::read(kept.path().join("ram")).expect("it can be read");
        let word = |at: u64| {
            let at = usize::try_from(at).expect("it is small");
            u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
        };
        let memory = memory_of(&kept, offset);
        let users = memory.data.offset + u64::from(BELL_BYTES);
        assert_eq!(word(users + 16), 0x1234_5678);
        assert_eq!(word(users + memory.data.stride + 20), 0x9abc_def0);
        let second_mail = memory.mail.offset + memory.mail.stride;
        assert_eq!(word(second_mail + u64::from(header::LAST_INCARNATION)), 77);
        let process = word(memory.mail.offset + u64::from(header::PROCESS_ID));
        assert_eq!(process, std::process::id());
        let mut files: Vec<_> = fs::read_dir(kept.path().join("system"))
            .expect("it can be listed")
            .map(|entry| entry.expect("it can be listed").file_name())
            .collect();
        files.sort();
        assert_eq!(files, ["0.bell", "0.mail", "1.bell", "1.mail", "system"]);
    }
}

/// What `in_memory` made, without making the file anew.
fn memory_of(kept: &TempDir, offset: u64) -> Memory {
    let elsewhere = tempfile::tempdir().expect("a temporary directory");
    Memory {
        file: kept.path().join("ram"),
        ..memory(elsewhere.path(), offset)
    }
}

#[test]
fn the_memory_stays_when_its_system_is_removed() {
    let (kept, system) = in_memory(0x1234);
    let claim = system.claim(SECOND).expect("it is free");
    let error = system.clone().remove_within(Duration::ZERO);
    let error = error.expect_err("it is in use");
    assert!(
        matches!(error, SystemError::NumberTaken { number: SECOND, process_id }
            if process_id == std::process::id()),
        "{error}"
    );
    store(&claim, 0, 0, 5);
    drop(claim);
    system
        .clone()
        .remove_within(PATIENCE)
        .expect("nobody has it");
    assert!(!kept.path().join("system").exists());
    let memory = memory_of(&kept, 0x1234);
    let system = LinuxSystem::<2>::in_memory(kept.path().join("system"), USER_BYTES, &memory)
        .expect("it begins anew");
    let claim = system.claim(FIRST).expect("it is free");
    assert_eq!(load(&claim, 0, 0), 5);
}

#[test]
fn a_memory_that_is_wrong_is_refused() {
    let (kept, system) = in_memory(0x4000);
    let (path, ram) = (kept.path().join("system"), kept.path().join("ram"));
    let resize = |bytes| {
        let file = fs::File::options().write(true).open(&ram);
        file.and_then(|file| file.set_len(bytes))
            .expect("it is ours");
    };
    let last = 0x4000 + (1 << 16) + u64::from(BELL_BYTES + USER_BYTES);
    resize(last + 316);
    let error = refusal(&system);
    let text = error.to_string();
    let SystemError::OutsideMemory {
        path: wrong,
        object,
        offset,
        bytes,
        found,
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!((wrong, object.as_str()), (ram.clone(), "1.data"));
    assert_eq!((offset, bytes, found), (last, 320, last + 316));
    let place = format!("1.data needs 320 bytes at offset {last:#x} of {ram:?}");
    assert!(text.starts_with(&place), "{text}");
    resize(last + 320);
    system
        .claim_within(FIRST, PATIENCE)
        .expect("it is free again");

    for (wrong, expected) in [
        (
            LinuxSystem::<2>::at(&path, USER_BYTES + 4).err(),
            "data-bytes is [256], expected 260",
        ),
        (
            LinuxSystem::<3>::at(&path, USER_BYTES).err(),
            "processors is [2], expected 3",
        ),
        (
            LinuxSystem::<2>::in_memory(&path, USER_BYTES, &memory_of(&kept, 0x4004)).err(),
            "its memory is Some(Memory",
        ),
        (
            LinuxSystem::<2>::in_memory(
                kept.path().join("other"),
                USER_BYTES,
                &memory_of(&kept, 2),
            )
            .err(),
            "0.mail at 0x2 does not begin at a multiple of 4",
        ),
    ] {
        let error = wrong.expect("it is refused").to_string();
        assert!(error.contains(expected), "{error}");
    }

    fs::remove_file(&ram).expect("it is there");
    let error = system.claim(FIRST).expect_err("the memory is gone");
    assert!(
        matches!(&error, SystemError::Os { doing: "open", path, .. } if *path == ram),
        "{error}"
    );
    symlink("/dev/null", &ram).expect("a link");
    let error = system.claim(FIRST).expect_err("no link is followed");
    assert!(matches!(error, SystemError::WrongKind { .. }), "{error}");
    fs::remove_file(path.join("system")).expect("it is ours");
    fs::write(path.join("system"), "something else").expect("it is ours");
    let error = system.claim(FIRST).expect_err("it says nothing");
    assert!(matches!(error, SystemError::OtherSystem { .. }), "{error}");
}

#[test]
fn a_system_of_files_does_not_become_one_in_memory() {
    let (kept, system) = directory();
    drop(system.claim(FIRST).expect("it is free"));
    let path = kept.path().join("system");
    let memory = memory(kept.path(), 0);
    let error = LinuxSystem::<2>::in_memory(path, USER_BYTES, &memory).expect_err("it has begun");
    let expected = "its memory is None, expected Some(Memory";
    assert!(error.to_string().contains(expected), "{error}");
}

#[test]
fn removal_may_race_with_claims() {
    let (_kept, system) = directory();
    let stop = AtomicBool::new(false);
    thread::scope(|scope| {
        let _ends = StopAtEnd(&stop);
        for _ in 0..2 {
            scope.spawn(|| {
                while !stop.load(Ordering::Relaxed) {
                    // In use, more often than not.
                    let _ = system.clone().remove_within(Duration::ZERO);
                }
            });
        }
        let claim = |number| loop {
            match system.claim_within(number, Duration::ZERO) {
                Ok(claim) => break claim,
                // The other thread holds all numbers while it removes.
                Err(SystemError::NumberTaken { .. } | SystemError::Unsteady { .. }) => {}
                Err(error) => panic!("{error}"),
            }
        };
        for value in 1..500 {
            let first = claim(FIRST);
            let second = claim(SECOND);
            store(&first, 1, 0, value);
            assert_eq!(load(&second, 1, 0), value, "both claim the same system");
            assert_eq!(first.doorbell().evidence(SECOND), Evidence::Alive);
        }
    });
}

/// Ends the other thread also if this one panics.
struct StopAtEnd<'a>(&'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn holder_of(system: &LinuxSystem<2>) -> Actor {
    let mut holder = Actor::start("system::the_parts", "holder", |command| {
        system.pass_to(command);
    });
    assert_eq!(holder.hear().as_deref(), Some("held"));
    holder
}

/// What the children do; nothing in the parent.
#[test]
fn the_parts() {
    match part().as_deref() {
        Some("holder") => {
            let system = LinuxSystem::<2>::inherited().expect("it was passed");
            let claim = system.claim(SECOND).expect("it is free");
            let (mail, id) = (&claim.windows()[1].mail, std::process::id());
            mail.store(header::PROCESS_ID, id, StoreOrder::Relaxed)
                .expect("it is inside");
            store(&claim, 0, 8, id);
            say("held");
            wait_for_parent();
        }
        Some("parent of a holder") => {
            // The system is named in the environment that the child gets.
            let mut holder = Actor::start("system::the_parts", "holder", |_| {});
            say(&holder.hear().unwrap_or_default());
            wait_for_parent();
        }
        Some("bystander") => {
            say("ready");
            wait_for_parent();
        }
        Some("inheritor") => match LinuxSystem::<2>::inherited() {
            Ok(_) => say("inherited"),
            Err(error) => say(&error.to_string()),
        },
        Some(other) => panic!("nobody plays {other}"),
        None => {}
    }
}
