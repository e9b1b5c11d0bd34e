//! Interrupts of UIO devices, with a socket in place of `/dev/uio`*n* whose other end does what the
//! kernel's driver does.
//!
//! What that cannot show: that a device's line really masks and unmasks as the driver says.
#![cfg(all(
    feature = "linux",
    feature = "conformance",
    target_os = "linux",
    target_arch = "x86_64"
))]

use std::os::fd::OwnedFd;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use condor_dev::conformance::interrupt_controller;
use condor_dev::linux::UioInterrupts;
use condor_dev::{InterruptController, InterruptLevel, InterruptVector};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};

const ONE: InterruptVector = InterruptVector(64);
const OTHER: InterruptVector = InterruptVector(65);
const NOBODY: InterruptVector = InterruptVector(66);
/// Nothing here takes as long.
const LONG: Duration = Duration::from_secs(20);

/// The kernel's side of one device, as `uio_pdrv_genirq` has it: an interrupt is counted and
/// masked; writing 1 unmasks it, writing 0 masks it.
struct Kernel {
    vector: InterruptVector,
    end: OwnedFd,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    raised: bool,
    unmasked: bool,
    count: u32,
}

impl Kernel {
    fn set(&self, raised: bool) {
        let mut state = self.state.lock().unwrap();
        state.raised = raised;
        drop(state);
        self.settle();
    }

    /// Takes what the program has written, and interrupts if it may.
    fn settle(&self) {
        let mut state = self.state.lock().unwrap();
        loop {
            let mut word = [0; 4];
            match rustix::io::read(&self.end, &mut word) {
                Ok(4) => state.unmasked = i32::from_ne_bytes(word) == 1,
                Err(Errno::AGAIN) => break,
                other => panic!("the program wrote {other:?}"),
            }
            self.interrupt(&mut state);
        }
        self.interrupt(&mut state);
    }

    fn interrupt(&self, state: &mut State) {
        if state.raised && state.unmasked {
            state.unmasked = false;
            state.count += 1;
            rustix::io::write(&self.end, &state.count.to_ne_bytes()).unwrap();
        }
    }
}

fn device(vector: InterruptVector) -> (Kernel, (InterruptVector, OwnedFd)) {
    let kind = SocketType::SEQPACKET;
    let (end, device) = socketpair(AddressFamily::UNIX, kind, SocketFlags::CLOEXEC, None).unwrap();
    rustix::io::ioctl_fionbio(&end, true).unwrap();
    let kernel = Kernel {
        vector,
        end,
        state: Mutex::default(),
    };
    (kernel, (vector, device))
}

/// The controller, after each call of which the kernel has done its part.
struct Settled<'c> {
    interrupts: &'c UioInterrupts,
    kernels: &'c [Kernel],
}

impl Settled<'_> {
    fn settle(&self) {
        self.kernels.iter().for_each(Kernel::settle);
    }
}

impl InterruptController for Settled<'_> {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        self.interrupts.enable(vector, level);
        self.settle();
    }

    fn disable(&self, vector: InterruptVector) {
        self.interrupts.disable(vector);
        self.settle();
    }

    fn claim(&self) -> Option<InterruptVector> {
        self.interrupts.claim()
    }

    fn complete(&self, vector: InterruptVector) {
        self.interrupts.complete(vector);
        self.settle();
    }
}

fn machine() -> (UioInterrupts, [Kernel; 2]) {
    let ((one, first), (other, second)) = (device(ONE), device(OTHER));
    let interrupts = UioInterrupts::new([first, second]).unwrap();
    (interrupts, [one, other])
}

#[test]
fn conforms() {
    let (interrupts, kernels) = machine();
    let settled = Settled {
        interrupts: &interrupts,
        kernels: &kernels,
    };
    let set = |vector, raised| {
        let kernel = kernels.iter().find(|kernel| kernel.vector == vector);
        kernel.unwrap().set(raised);
    };
    for lines in [[ONE, OTHER], [OTHER, ONE]] {
        interrupt_controller(&settled, lines, NOBODY, set).unwrap();
    }
}

#[test]
fn waits_for_an_interrupt_until_the_deadline() {
    let (interrupts, [one, other]) = machine();
    assert!(!interrupts.wait(Instant::now()).unwrap());
    interrupts.enable(ONE, InterruptLevel(1));
    one.settle();
    let soon = Instant::now() + Duration::from_millis(1);
    assert!(!interrupts.wait(soon).unwrap());
    assert!(Instant::now() >= soon);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            other.set(true);
            one.set(true);
        });
        assert!(interrupts.wait(Instant::now() + LONG).unwrap());
    });
    assert_eq!(interrupts.claim(), Some(ONE), "the other one is disabled");
    assert!(
        !interrupts.wait(Instant::now()).unwrap(),
        "it is in service"
    );
    interrupts.complete(ONE);
    one.settle();
    assert!(interrupts.wait(Instant::now()).unwrap(), "it still asks");
}

#[test]
fn one_of_several_threads_claims() {
    let (interrupts, [one, _]) = machine();
    interrupts.enable(ONE, InterruptLevel(1));
    for _ in 0..200 {
        one.set(true);
        let claims: usize = std::thread::scope(|threads| {
            let claim = || usize::from(interrupts.claim().is_some());
            let claiming = [threads.spawn(claim), threads.spawn(claim)];
            claiming.map(|thread| thread.join().unwrap()).iter().sum()
        });
        assert_eq!(claims, 1);
        one.set(false);
        interrupts.complete(ONE);
        one.settle();
    }
}

#[test]
fn a_device_that_vanished_interrupts_no_more() {
    let (interrupts, [one, other]) = machine();
    interrupts.enable(ONE, InterruptLevel(1));
    interrupts.enable(OTHER, InterruptLevel(1));
    drop(one);
    other.set(true);
    assert_eq!(interrupts.claim(), Some(OTHER));
    assert!(interrupts.is_lost(ONE) && !interrupts.is_lost(OTHER));
    assert!(!interrupts.wait(Instant::now()).unwrap());
}

#[test]
fn so_many_devices_can_be_waited_for() {
    let devices = |count: u16| (0..count).map(|number| device(InterruptVector(number)));
    let (kernels, lines): (Vec<_>, Vec<_>) = devices(64).unzip();
    let interrupts = UioInterrupts::new(lines).unwrap();
    for number in 0..64 {
        interrupts.enable(InterruptVector(number), InterruptLevel(1));
    }
    let last = kernels.last().unwrap();
    last.settle();
    last.set(true);
    assert!(interrupts.wait(Instant::now() + LONG).unwrap());
    assert_eq!(interrupts.claim(), Some(InterruptVector(63)));
    let (_kernels, lines): (Vec<_>, Vec<_>) = devices(65).unzip();
    let error = UioInterrupts::new(lines).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput);
    let none = UioInterrupts::new([]).unwrap();
    assert!(!none.wait(Instant::now()).unwrap());
}
