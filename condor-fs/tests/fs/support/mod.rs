//! A system of three processors: a server in a process of its own, which is started again whenever
//! it dies, and clients in this one.
#![cfg(all(feature = "linux", target_os = "linux"))]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use condor_fs::server::{FileServer, ServerOptions, Step, Steps};
use condor_fs::wire::{OPEN_FILES, Operation};
use condor_fs::{Area, FileError, FileSystem};
use condor_mbox::linux::{LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, Processor, Region};
use rustix::fs::{Gid, Uid};

/// The kind of filesystem that never uses an inode number again.
const TMPFS: u64 = 0x0102_1994;

pub(crate) const N: usize = 3;
pub(crate) const FILES: usize = 8;
pub(crate) const SERVER: Processor = Processor(0);
pub(crate) const CLIENT: Processor = Processor(1);
pub(crate) const OTHER: Processor = Processor(2);
pub(crate) const TIMEOUT: Duration = Duration::from_secs(60);
const BYTES: u32 = 128 * 1024;
const PART: &str = "CONDOR_FS_TEST_SERVER";

pub(crate) type Mail<'v> = LinuxMailbox<'v, N>;
pub(crate) type Fs<'m, 'v> = FileSystem<'m, Mail<'v>, LinuxWindow, FILES>;
pub(crate) type AnyFs<'m, 'v, const N: usize, const FILES: usize> =
    Result<FileSystem<'m, LinuxMailbox<'v, N>, LinuxWindow, FILES>, FileError>;
pub(crate) type Own = Region<LinuxWindow>;

/// What a program of the host appends to the file `log`, as the option `host-appends` has it.
pub(crate) const BY_HOST: &[u8] = b"by the host ";

/// Kills the own process where it is told to.
struct KillAt {
    operation: u32,
    step: String,
    left: AtomicU32,
    /// A program of the host appends to this then.
    log: Option<PathBuf>,
    /// It is not killed.
    spare: bool,
}

impl Steps for KillAt {
    fn reached(&self, operation: Operation, step: Step) {
        if operation as u32 == self.operation
            && format!("{step:?}") == self.step
            && self.left.fetch_sub(1, Ordering::Relaxed) == 1
        {
            if let Some(log) = &self.log {
                let mut log = std::fs::File::options().append(true).open(log).unwrap();
                log.write_all(BY_HOST).unwrap();
            }
            if !self.spare {
                let own = rustix::process::getpid();
                let _ = rustix::process::kill_process(own, rustix::process::Signal::KILL);
            }
        }
    }
}

/// Where the n-th time kills the server, beginning with 1.
pub(crate) type Kill = (Operation, Step, u32);

/// Is the server, in a process that was started for it; nothing in the parent.
#[test]
fn server_process() {
    let Ok(part) = std::env::var(PART) else {
        return;
    };
    let words: Vec<&str> = part.split('|').collect();
    let [root, operation, step, count, options] = words[..] else {
        panic!("{part}");
    };
    let has = |option: &str| options.split(' ').any(|word| word == option);
    let value = |option: &str| {
        let mut words = options.split(' ');
        words.find_map(|word| word.strip_prefix(option)?.strip_prefix('='))
    };
    let steps = KillAt {
        operation: operation.parse().unwrap(),
        step: step.into(),
        left: AtomicU32::new(count.parse().unwrap()),
        log: has("host-appends").then(|| Path::new(root).join("log")),
        spare: has("spare"),
    };
    let default = ServerOptions::default();
    let mode = |option, default| {
        value(option).map_or(default, |mode| u32::from_str_radix(mode, 8).unwrap())
    };
    if let Some(bytes) = value("file-limit") {
        limit_files(bytes.parse().unwrap());
    }
    let options = ServerOptions {
        read_only: has("read-only"),
        max_file_bytes: value("max-file").map(|bytes| bytes.parse().unwrap()),
        quota_bytes: value("quota").map(|bytes| bytes.parse().unwrap()),
        file_mode: mode("file-mode", default.file_mode),
        directory_mode: mode("directory-mode", default.directory_mode),
        ..default
    };
    if let Some(most) = value("descriptors") {
        let most = most.parse().ok();
        let limit = rustix::process::Rlimit {
            current: most,
            maximum: most,
        };
        rustix::process::setrlimit(rustix::process::Resource::Nofile, limit).unwrap();
    }
    let claim = LinuxSystem::<N>::inherited()
        .unwrap()
        .claim(SERVER)
        .unwrap();
    // By a path that everybody can go.
    std::env::set_current_dir(root).unwrap();
    if has("nobody") {
        become_nobody();
    }
    let server = FileServer::with_steps(".", options, steps).unwrap();
    server.serve(claim, &AtomicBool::new(false)).unwrap();
}

/// Whether every user can go to `path`; says so if not.
pub(crate) fn everybody_reaches(path: &std::path::Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    let closed = path.ancestors().skip(1).find(|above| {
        std::fs::metadata(above).is_ok_and(|above| above.permissions().mode() & 0o001 == 0)
    });
    if let Some(closed) = closed {
        println!(
            "SKIPPED: the user nobody cannot go through {}",
            closed.display()
        );
    }
    closed.is_none()
}

/// The user and the group `nobody`.
pub(crate) const NOBODY: u32 = 65534;

/// Gives up this thread's privileges, if it has any.
pub(crate) fn become_nobody() {
    if is_root() {
        let (user, group) = (Uid::from_raw(NOBODY), Gid::from_raw(NOBODY));
        rustix::thread::set_thread_groups(&[]).unwrap();
        rustix::thread::set_thread_res_gid(group, group, group).unwrap();
        rustix::thread::set_thread_res_uid(user, user, user).unwrap();
    }
}

pub(crate) fn is_root() -> bool {
    rustix::process::geteuid().is_root()
}

/// Lets the kernel end this process if it makes a file longer.
fn limit_files(bytes: u64) {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = Rlimit {
        current: Some(bytes),
        maximum: getrlimit(Resource::Fsize).maximum,
    };
    setrlimit(Resource::Fsize, limit).unwrap();
}

/// A directory on a disk, where inode numbers are used again, as they are not on tmpfs: in cargo's
/// directory for tests, or in the one that `CONDOR_FS_TEST_DIR` names.
pub(crate) fn disk() -> tempfile::TempDir {
    let place = std::env::var("CONDOR_FS_TEST_DIR").map_or_else(
        |_| PathBuf::from(env!("CARGO_TARGET_TMPDIR")),
        PathBuf::from,
    );
    let directory = tempfile::tempdir_in(place).unwrap();
    let kind = rustix::fs::statfs(directory.path()).unwrap().f_type;
    assert_ne!(
        kind.cast_unsigned(),
        TMPFS,
        "{directory:?} is on a tmpfs: set CONDOR_FS_TEST_DIR to a directory on a disk"
    );
    directory
}

/// Keeps a server running.
pub(crate) struct Supervisor {
    stop: Arc<AtomicBool>,
    deaths: Arc<AtomicU32>,
    child: Arc<AtomicU32>,
    thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// The first server dies as `kill` says; with `every-incarnation` in `options`, all others as soon as they
    /// take that operation.
    pub(crate) fn start(
        system: &Arc<LinuxSystem<N>>,
        root: &Path,
        kill: Option<Kill>,
        options: &'static str,
    ) -> Self {
        let (stop, deaths, child) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicU32::new(0)),
            Arc::new(AtomicU32::new(0)),
        );
        let mut supervisor = Self {
            stop: stop.clone(),
            deaths: deaths.clone(),
            child: child.clone(),
            thread: None,
        };
        let (system, root) = (system.clone(), root.to_owned());
        let thread = std::thread::spawn(move || {
            let mut kill = kill;
            while !stop.load(Ordering::SeqCst) {
                let how = kill.map_or("0|-|0".into(), |(operation, step, count)| {
                    format!("{}|{step:?}|{count}", operation as u32)
                });
                kill = kill
                    .filter(|_| options.contains("every-incarnation"))
                    .map(|(operation, _, _)| (operation, Step::Taken, 1));
                let mut command = Command::new(std::env::current_exe().unwrap());
                command
                    .args(["support::server_process", "--exact", "--nocapture"])
                    .env(PART, format!("{}|{how}|{options}", root.display()))
                    .stdout(Stdio::null());
                let mut process = system.pass_to(&mut command).spawn().unwrap();
                child.store(process.id(), Ordering::SeqCst);
                process.wait().unwrap();
                child.store(0, Ordering::SeqCst);
                deaths.fetch_add(1, Ordering::SeqCst);
            }
        });
        supervisor.thread = Some(thread);
        supervisor
    }

    /// How often the server has died.
    pub(crate) fn deaths(&self) -> u32 {
        self.deaths.load(Ordering::SeqCst)
    }

    /// Kills the server that runs now, and waits until it is dead.
    pub(crate) fn die(&self) {
        let before = self.deaths();
        // A server may serve before its number is noted here.
        eventually(|| self.kill().ok_or("no server has started"));
        eventually(|| {
            (self.deaths() > before)
                .then_some(())
                .ok_or("the server has not died")
        });
    }

    /// Kills the server that runs now; `None` if none is known.
    pub(crate) fn kill(&self) -> Option<()> {
        let number = self.child.load(Ordering::SeqCst);
        let process = rustix::process::Pid::from_raw(number.cast_signed())?;
        let _ = rustix::process::kill_process(process, rustix::process::Signal::KILL);
        Some(())
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        let thread = self.thread.take();
        self.stop.store(true, Ordering::SeqCst);
        while thread.as_ref().is_some_and(|thread| !thread.is_finished()) {
            self.kill();
            std::thread::yield_now();
        }
    }
}

pub(crate) fn system() -> Arc<LinuxSystem<N>> {
    Arc::new(LinuxSystem::family(BYTES).unwrap())
}

/// Ends the server also if the program panics.
pub(crate) struct StopAtEnd<'a>(pub(crate) &'a AtomicBool);

impl Drop for StopAtEnd<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Tries until it succeeds: another process may keep this one from its processor.
pub(crate) fn eventually<T, E: std::fmt::Display>(attempt: impl Fn() -> Result<T, E>) -> T {
    let deadline = Instant::now() + Duration::from_secs(100);
    loop {
        match attempt() {
            Ok(done) => return done,
            Err(error) => assert!(Instant::now() < deadline, "{error}"),
        }
        std::thread::yield_now();
    }
}

/// Runs `program` on a processor with files.
pub(crate) fn with_client<R>(
    system: &LinuxSystem<N>,
    number: Processor,
    program: impl FnOnce(&Fs<'_, '_>, &Own, &mut Allocator, &Mail<'_>) -> R,
) -> R {
    with_own_client(system, number, |files, own, allocator, mail| {
        program(&files, own, allocator, mail)
    })
}

/// The same, with the `FileSystem` to keep.
pub(crate) fn with_own_client<R>(
    system: &LinuxSystem<N>,
    number: Processor,
    program: impl FnOnce(Fs<'_, '_>, &Own, &mut Allocator, &Mail<'_>) -> R,
) -> R {
    try_client(
        system,
        number,
        (300, 4096),
        |files, own, allocator, mail| program(files.unwrap(), own, allocator, mail),
    )
}

/// The same in a system of any size, with what the server says; `room` is bytes of a path, and of a
/// file's buffer.
pub(crate) fn try_client<R, const N: usize, const FILES: usize>(
    system: &LinuxSystem<N>,
    number: Processor,
    room: (u32, u32),
    program: impl FnOnce(AnyFs<'_, '_, N, FILES>, &Own, &mut Allocator, &LinuxMailbox<'_, N>) -> R,
) -> R {
    let mut claim = system.claim_within(number, TIMEOUT).unwrap();
    let own = Region::users(claim.windows()[number.index()].data.clone()).unwrap();
    let mut allocator = claim.places().unwrap();
    let area = Area::<FILES>::new(&mut allocator, room.0, room.1).unwrap();
    let handler = area.handler();
    let mut mailbox = claim.mailbox().unwrap();
    mailbox
        .set_vector(OPEN_FILES, &handler, "open files")
        .unwrap();
    mailbox.join().unwrap();
    let files = FileSystem::connect(&mailbox, SERVER, own.clone(), area, TIMEOUT);
    program(files, &own, &mut allocator, &mailbox)
}

/// Runs `program` on a processor that does not say where its table of open files is.
pub(crate) fn with_silent_client<R>(
    system: &LinuxSystem<N>,
    number: Processor,
    program: impl FnOnce(Fs<'_, '_>) -> R,
) -> R {
    let mut claim = system.claim_within(number, TIMEOUT).unwrap();
    let own = Region::users(claim.windows()[number.index()].data.clone()).unwrap();
    let area = Area::<FILES>::new(&mut claim.places().unwrap(), 300, 4096).unwrap();
    let mut mailbox = claim.mailbox().unwrap();
    mailbox.join().unwrap();
    program(FileSystem::connect(&mailbox, SERVER, own, area, TIMEOUT).unwrap())
}

/// With a server of `root` that never dies.
pub(crate) fn with_server<R>(
    root: &Path,
    options: &'static str,
    program: impl FnOnce(&Fs<'_, '_>, &Own, &mut Allocator, &Mail<'_>) -> R,
) -> R {
    let system = system();
    let _supervisor = Supervisor::start(&system, root, None, options);
    with_client(&system, CLIENT, program)
}

/// All that is in a directory: paths and contents, in order.
pub(crate) fn snapshot(root: &Path) -> Vec<(String, Option<Vec<u8>>)> {
    let mut found = Vec::new();
    let mut left = vec![root.to_owned()];
    while let Some(directory) = left.pop() {
        for entry in std::fs::read_dir(&directory).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(root).unwrap().display().to_string();
            if name == ".condor-fs/journal" || name == ".condor-fs/lock" {
                continue;
            }
            if path.is_dir() {
                found.push((name, None));
                left.push(path);
            } else {
                found.push((name, Some(std::fs::read(&path).unwrap())));
            }
        }
    }
    found.sort();
    found
}
