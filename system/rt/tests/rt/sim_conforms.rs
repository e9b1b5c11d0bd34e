//! The parts of a processor in virtual time keep the promises of their traits.
#![cfg(feature = "sim")]

use condor_mos::Platform as _;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::{Clock, Doorbell, Processor, conformance};
use condor_rt::{Machine, sim};

const ME: Processor = Processor(0);
const OTHER: Processor = Processor(1);

#[test]
fn the_doorbell() {
    let others = Mutex::new(None);
    let mut system = sim::VirtualSystem::new(64).unwrap();
    system
        .host(ME, |machine| {
            machine.work(1000);
            let other: sim::Bell = others.lock().unwrap().take().unwrap();
            conformance::doorbell(&machine.doorbell(), ME, || other.ring(ME))
        })
        .unwrap();
    system
        .host(OTHER, |machine| {
            *others.lock().unwrap() = Some(machine.doorbell());
            Ok::<_, String>(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn the_timer() {
    let mut system = sim::VirtualSystem::new(64).unwrap();
    system
        .host(ME, |machine| {
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
                        let until = bell.now().after(Duration::from_micros(100));
                        bell.wait(bell.prepare(), until, None);
                    },
                )
            });
            verdict.unwrap()
        })
        .unwrap();
    system.run().unwrap();
}
