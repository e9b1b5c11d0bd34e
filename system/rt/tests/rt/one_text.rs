//! One program text in virtual time and as a process of Linux.
#![cfg(feature = "sim")]

use std::fs;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Output, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::small::{SMALL, Seen, Small, VISITOR, watch};
use condor_clock::Obstacle;
use condor_clock::linux::Futex;
use condor_mbox::linux::LinuxSystem;
use condor_mbox::{MemoryWindow, Region};
use condor_mos::Statistics;
use condor_rt::linux::{self, Environment, FileRange, LoopContext, MappedPage};
use condor_rt::objects::{self, ObjectKind};
use condor_rt::{Machine as _, PROCESSORS, loops, sim};

use crate::environment;

const WINDOW_BYTES: u32 = 8192;

fn in_virtual_time() -> Seen {
    let seen = Mutex::new(None);
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.arguments(SMALL, ["2"]).unwrap();
    system.spawn(SMALL, &Small).unwrap();
    system
        .host(VISITOR, |machine| {
            let mailbox = machine.mailbox().unwrap();
            *seen.lock().unwrap() = Some(watch(mailbox));
            Ok::<_, String>(())
        })
        .unwrap();
    system.run_until(1_000_000_000).unwrap();
    seen.into_inner().unwrap().unwrap()
}

#[test]
fn the_program_in_virtual_time() {
    let seen = in_virtual_time();
    assert_eq!(seen.reply, 42);
    assert_eq!((seen.counts.skipped, seen.counts.worst_lateness), (0, 0));
    assert!((80..=100).contains(&seen.counts.run), "{seen:?}");
    assert_eq!(seen, in_virtual_time());
}

/// Not a test, but the process that the tests below start.
#[test]
fn small_process() {
    if std::env::var_os("CONDOR_PROCESS").is_none() {
        return;
    }
    // SAFETY: its loop adds and stores.
    let code = unsafe { linux::run_allowing_signals(&Small, ["2".to_owned()]) };
    assert_eq!(format!("{code:?}"), format!("{:?}", ExitCode::SUCCESS));
}

fn environment(directory: &Path, loops: LoopContext) -> Environment {
    environment::environment(directory, SMALL, WINDOW_BYTES, loops)
}

fn start(environment: &Environment, change: impl FnOnce(&mut Command)) -> Child {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["one_text::small_process", "--exact", "--nocapture"]);
    environment.pass_to(&mut command).unwrap();
    change(&mut command);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

fn as_process(loops: LoopContext) {
    let directory = tempfile::tempdir().unwrap();
    let environment = Environment {
        // What the kernel refuses is told, and the program runs.
        cpu: Some(1_000_000),
        ..environment(directory.path(), loops)
    };
    let system = LinuxSystem::<PROCESSORS>::at(&environment.system, WINDOW_BYTES).unwrap();
    let claim = system.claim(VISITOR).unwrap();
    let child = start(&environment, |_| ());
    let mailbox = claim.mailbox().unwrap();
    let seen = watch(mailbox);
    assert_eq!(seen.reply, 42);
    // Skips are the host's affair, which may be busy; but none is forgotten.
    let counts = seen.counts;
    let accounted = counts.run + counts.skipped + counts.running + counts.pending;
    assert_eq!(counts.released, accounted);
    assert!(
        counts.run >= 80 && u64::from(seen.ticks) >= counts.run,
        "{seen:?}"
    );
    let kill = Command::new("kill").arg(child.id().to_string()).status();
    assert!(kill.unwrap().success());
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&stderr);
    let refused = "the kernel refuses the thread on core 1000000";
    assert!(status.success() && stderr.contains(refused), "{stderr}");
}

#[test]
fn the_program_as_a_process_with_threads() {
    as_process(LoopContext::Threads);
}

#[test]
fn the_program_as_a_process_with_signals() {
    as_process(LoopContext::Signals);
}

#[test]
fn the_program_as_a_process_that_spins() {
    as_process(LoopContext::Spin);
}

/// What a loop of 400 Hz counts that takes 3 ms: just before the first second is over, nobody has looked
/// at it.
const END_NS: u64 = 999_999_999;
const WORK_NS: u64 = 3_000_000;

fn counts(region: &Region<impl MemoryWindow + Clone>) -> Statistics {
    let servo = objects::find(region, "servo", ObjectKind::Loop)
        .unwrap()
        .unwrap();
    loops::read(region, &servo).unwrap().unwrap().0
}

fn overruns_in_virtual_time() -> Statistics {
    let seen = Mutex::new(None);
    let mut system = sim::VirtualSystem::new(WINDOW_BYTES).unwrap();
    system.arguments(SMALL, ["2"]).unwrap();
    system.set_work(SMALL, 0, WORK_NS).unwrap();
    system.spawn(SMALL, &Small).unwrap();
    system
        .host(VISITOR, |machine| {
            machine.work(END_NS);
            let windows = machine.windows();
            let region = Region::users(windows[SMALL.index()].data.clone());
            *seen.lock().unwrap() = Some(counts(&region.unwrap()));
            Ok::<_, String>(())
        })
        .unwrap();
    system.run_until(END_NS + 1).unwrap();
    seen.into_inner().unwrap().unwrap()
}

#[test]
fn the_program_as_a_process_in_simulated_time() {
    let directory = tempfile::tempdir().unwrap();
    let page = directory.path().join("page");
    let file = fs::File::create_new(&page).unwrap();
    file.set_len(MappedPage::BYTES.into()).unwrap();
    let mut environment = Environment {
        clock: Some(FileRange::whole(page)),
        ..environment(directory.path(), LoopContext::Threads)
    };
    environment.work_ns[0] = WORK_NS;
    let page = MappedPage::map(environment.clock.as_ref().unwrap()).unwrap();
    page.reset(0);
    page.set_limit(END_NS);
    let system = LinuxSystem::<PROCESSORS>::at(&environment.system, WINDOW_BYTES).unwrap();
    let claim = system.claim(VISITOR).unwrap();
    let mut child = start(&environment, |_| ());
    let until = Instant::now() + Duration::from_secs(60);
    while page.standing(&Futex::new()) != Obstacle::Limit {
        assert!(Instant::now() < until, "{}", page.standing(&Futex::new()));
        std::thread::yield_now();
    }
    let seen = counts(&claim.region(SMALL).unwrap());
    assert_eq!(seen, overruns_in_virtual_time());
    assert_eq!((seen.worst_run, seen.worst_lateness), (3_000_000, 0));
    assert!(seen.skipped > 150, "{seen:?}");
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_successor_waits_for_the_number_and_a_bus_must_be_there() {
    let directory = tempfile::tempdir().unwrap();
    let environment = environment(directory.path(), LoopContext::Threads);
    let system = LinuxSystem::<PROCESSORS>::at(&environment.system, WINDOW_BYTES).unwrap();
    let held = system.claim(SMALL).unwrap();
    let mut child = start(&environment, |_| ());
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(child.try_wait().unwrap(), None);
    drop(held);
    let mailbox = system.claim(VISITOR).unwrap().mailbox().unwrap();
    assert_eq!(watch(mailbox).reply, 42);
    child.kill().unwrap();
    child.wait().unwrap();

    let bus = directory.path().join("bus");
    let environment = Environment {
        bus: Some(FileRange::whole(bus.clone())),
        ..environment
    };
    let says = |child: Child| {
        let output = child.wait_with_output().unwrap();
        assert!(!output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let text = says(start(&environment, |_| ()));
    assert!(
        text.contains(&format!("cannot open the bus {bus:?}")),
        "{text}"
    );
    fs::write(&bus, []).unwrap();
    let text = says(start(&environment, |_| ()));
    assert!(text.contains("cannot map the bus"), "{text}");
    let text = says(start(&environment, |command| {
        command.env("CONDOR_PROCESS", "{}");
    }));
    assert!(
        text.contains("CONDOR_PROCESS in the environment is wrong: missing field `system`"),
        "{text}"
    );
}
