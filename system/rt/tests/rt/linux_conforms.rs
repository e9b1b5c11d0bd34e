//! The parts of a process keep the promises of their traits.
#![cfg(feature = "linux")]

use std::path::Path;

use condor_dev::{Bus as _, BusErrorKind};
use condor_mbox::MemoryWindow as _;
use condor_mbox::linux::LinuxSystem;
use condor_mbox::{Doorbell as _, Processor, conformance};
use condor_rt::linux::{Environment, FileRange, LinuxProcess, LoopContext};
use condor_rt::{Machine, PROCESSORS};

use crate::environment;

const ME: Processor = Processor(3);
const OTHER: Processor = Processor(4);

fn environment(directory: &Path, loops: LoopContext) -> Environment {
    environment::environment(directory, ME, 4096, loops)
}

fn with_machine(loops: LoopContext, test: impl FnOnce(&LinuxProcess, &LinuxSystem<PROCESSORS>)) {
    let directory = tempfile::tempdir().unwrap();
    let environment = environment(directory.path(), loops);
    let machine = LinuxProcess::new(&environment, []).unwrap();
    let system = LinuxSystem::at(&environment.system, environment.window_bytes).unwrap();
    test(&machine, &system);
}

#[test]
fn the_doorbell() {
    for loops in [LoopContext::Threads, LoopContext::Spin] {
        with_machine(loops, |machine, system| {
            let other = system.claim(OTHER).unwrap();
            let ring = || other.doorbell().ring(ME);
            conformance::doorbell(&machine.doorbell(), ME, ring).unwrap();
        });
    }
}

#[test]
fn the_bus_is_the_file_from_address_0_on() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bus");
    std::fs::write(&path, [0; 4096]).unwrap();
    let environment = Environment {
        bus: Some(FileRange::whole(path.clone())),
        ..environment(directory.path(), LoopContext::Threads)
    };
    let machine = LinuxProcess::new(&environment, []).unwrap();
    machine.bus().write16(4094, 0xadc0).unwrap();
    assert_eq!(std::fs::read(&path).unwrap()[4094..], [0xc0, 0xad]);
    let error = machine.bus().read8(4096).unwrap_err();
    assert_eq!(error.kind, BusErrorKind::OutOfRange);
    drop(machine);

    let environment = Environment {
        bus: Some(FileRange {
            path: path.clone(),
            offset: 1024,
            bytes: Some(512),
        }),
        ..environment
    };
    let machine = LinuxProcess::new(&environment, []).unwrap();
    machine.bus().write32(508, 0x0102_0304).unwrap();
    assert_eq!(std::fs::read(&path).unwrap()[1532..1536], [4, 3, 2, 1]);
    let error = machine.bus().read8(512).unwrap_err();
    assert_eq!(error.kind, BusErrorKind::OutOfRange);
    drop(machine);
    with_machine(LoopContext::Threads, |machine, _| {
        let error = machine.bus().read32(0).unwrap_err();
        assert_eq!((error.kind, error.address), (BusErrorKind::NoAnswer, 0));
    });
}

#[test]
fn shared_memory_is_the_same_for_all_and_belongs_to_nobody() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("shared");
    std::fs::write(&path, [0; 8192]).unwrap();
    let range = FileRange {
        path: path.clone(),
        offset: 4096,
        bytes: Some(1024),
    };
    let environment = Environment {
        shared_memory: Some(range.clone()),
        ..environment(directory.path(), LoopContext::Threads)
    };
    let machine = LinuxProcess::new(&environment, []).unwrap();
    let memory = machine.shared_memory().unwrap();
    assert_eq!(memory.size(), 1024);
    memory.set_word(1020, 7).unwrap();
    assert!(memory.set_word(1024, 7).is_err());
    drop(machine);
    // It outlives who wrote it.
    assert_eq!(range.window().unwrap().word(1020), Ok(7));
    assert_eq!(std::fs::read(&path).unwrap()[4096 + 1020], 7);
    std::fs::remove_file(&path).unwrap();
    let error = LinuxProcess::new(&environment, [])
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("cannot open the shared memory"), "{error}");
    with_machine(LoopContext::Threads, |machine, _| {
        assert!(machine.shared_memory().is_none());
    });
}

#[test]
fn a_machine_has_its_number_and_its_arguments() {
    let directory = tempfile::tempdir().unwrap();
    let environment = environment(directory.path(), LoopContext::Threads);
    let machine = LinuxProcess::new(&environment, ["a".to_owned()]).unwrap();
    assert_eq!(
        (machine.argument(0), machine.argument(1)),
        (Some("a"), None)
    );
    assert_eq!(machine.number(), ME);
}

#[test]
fn signals_must_be_allowed() {
    let directory = tempfile::tempdir().unwrap();
    let environment = environment(directory.path(), LoopContext::Signals);
    let refused = LinuxProcess::new(&environment, []).map(drop).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "CONDOR_PROCESS in the environment is wrong: `loops` must be `threads` or `spin`, since this program's `main` \
         does not allow signals"
    );
}
