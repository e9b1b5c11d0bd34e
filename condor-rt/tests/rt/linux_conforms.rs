//! The parts of a process that spins keep the promises of their traits.
#![cfg(feature = "linux")]

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use condor_dev::{Bus as _, BusErrorKind};
use condor_mbox::linux::System;
use condor_mbox::{Clock as _, Doorbell as _, Instant, Processor, conformance};
use condor_mos::{Armed, ConnectError, Platform, Timer as _};
use condor_rt::linux::{BusFile, Environment, Loops, Process};
use condor_rt::{Machine, PROCESSORS};

const ME: Processor = Processor(3);
const OTHER: Processor = Processor(4);

fn environment(directory: &Path) -> Environment {
    Environment {
        system: directory.join("mailbox"),
        window_bytes: 4096,
        processor: ME,
        bus: None,
        loops: Loops::Spin,
        cpu: None,
        priority: None,
    }
}

fn with_machine(test: impl FnOnce(&Process, &System<PROCESSORS>)) {
    let directory = tempfile::tempdir().unwrap();
    let environment = environment(directory.path());
    let machine = Process::spinning(&environment, []).unwrap();
    let system = System::at(&environment.system, environment.window_bytes).unwrap();
    test(&machine, &system);
}

#[test]
fn the_doorbell() {
    with_machine(|machine, system| {
        let other = system.claim(OTHER).unwrap();
        let ring = || other.doorbell().ring(ME);
        conformance::doorbell(&machine.doorbell(), ME, ring).unwrap();
    });
}

#[test]
fn the_timer() {
    with_machine(|machine, _| {
        let (timer, bell) = (machine.platform(), machine.doorbell());
        let interrupts = AtomicU32::new(0);
        let count = || {
            interrupts.fetch_add(1, Ordering::Relaxed);
        };
        let verdict = timer.connect(count, || {
            condor_mos::conformance::timer(
                &timer,
                || interrupts.load(Ordering::Relaxed),
                || {
                    bell.now();
                },
            )
        });
        assert_eq!(verdict.unwrap(), Ok(()));
    });
}

#[test]
fn a_wait_calls_the_handler_and_goes_on() {
    with_machine(|machine, _| {
        let (timer, bell) = (machine.platform(), machine.doorbell());
        let interrupts = AtomicU32::new(0);
        let handler = || {
            let count = interrupts.fetch_add(1, Ordering::Relaxed);
            // A poll in the handler is none.
            bell.now();
            if count < 4 {
                let _ = timer.arm(timer.now() + 1_000_000);
            }
        };
        let begun = timer.now();
        assert_eq!(timer.arm(begun), Armed::Past);
        let background = || bell.wait(bell.prepare(), Instant::from_ns(begun + 50_000_000), None);
        timer.connect(handler, background).unwrap();
        assert_eq!(interrupts.load(Ordering::Relaxed), 5);
        assert!(timer.now() >= begun + 50_000_000);
        // What was connected is gone.
        assert_eq!(timer.arm(begun), Armed::Past);
        bell.now();
        assert_eq!(interrupts.load(Ordering::Relaxed), 5);
    });
}

#[test]
fn one_scheduler_at_a_time() {
    with_machine(|machine, _| {
        let timer = machine.platform();
        let inner = || machine.platform().connect(|| (), || ());
        let outer = timer.connect(|| (), inner);
        assert_eq!(outer, Ok(Err(ConnectError::Connected)));
        assert_eq!(timer.connect(|| (), || ()), Ok(()));
    });
}

#[test]
fn the_bus_is_the_file_from_address_0_on() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("bus");
    std::fs::write(&path, [0; 4096]).unwrap();
    let environment = Environment {
        bus: Some(BusFile::whole(path.clone())),
        ..environment(directory.path())
    };
    let machine = Process::spinning(&environment, []).unwrap();
    machine.bus().write16(4094, 0xadc0).unwrap();
    assert_eq!(std::fs::read(&path).unwrap()[4094..], [0xc0, 0xad]);
    let error = machine.bus().read8(4096).unwrap_err();
    assert_eq!(error.kind, BusErrorKind::OutOfRange);
    drop(machine);

    let environment = Environment {
        bus: Some(BusFile {
            path: path.clone(),
            offset: 1024,
            bytes: Some(512),
        }),
        ..environment
    };
    let machine = Process::spinning(&environment, []).unwrap();
    machine.bus().write32(508, 0x0102_0304).unwrap();
    assert_eq!(std::fs::read(&path).unwrap()[1532..1536], [4, 3, 2, 1]);
    let error = machine.bus().read8(512).unwrap_err();
    assert_eq!(error.kind, BusErrorKind::OutOfRange);
    drop(machine);
    with_machine(|machine, _| {
        let error = machine.bus().read32(0).unwrap_err();
        assert_eq!((error.kind, error.address), (BusErrorKind::NoAnswer, 0));
    });
}

#[test]
fn what_the_kernel_refuses_is_told() {
    let directory = tempfile::tempdir().unwrap();
    let environment = Environment {
        cpu: Some(1_000_000),
        ..environment(directory.path())
    };
    let machine = Process::spinning(&environment, ["a".to_owned()]).unwrap();
    let refused: Vec<_> = machine.privileges().refused().map(|one| one.0).collect();
    assert_eq!(refused, ["the thread on core 1000000"]);
    assert_eq!(
        (machine.argument(0), machine.argument(1)),
        (Some("a"), None)
    );
    assert_eq!(machine.number(), ME);
}
