//! Every timer of this crate keeps the promises of `Timer`.

use std::sync::atomic::{AtomicU32, Ordering};

use condor_mos::conformance::timer_conforms;
use condor_mos::sim::{Processor, WrappingProcessor};
use condor_mos::{Rate, Timer};

/// Connects `timer`, which counts the ticks of `processor`.
fn simulated<T: Timer>(processor: &Processor, timer: &T) {
    let interrupts = AtomicU32::new(0);
    let count = || {
        interrupts.fetch_add(1, Ordering::Relaxed);
    };
    processor.with_handler(count, || {
        let step = || processor.run_until(Timer::now(processor) + 1);
        timer_conforms(timer, || interrupts.load(Ordering::Relaxed), step);
    });
    assert!(interrupts.into_inner() >= 3);
}

#[test]
fn simulated_timer_of_64_bits() {
    for frequency in [Rate::hz(1_000_000), Rate::hz(32_768), Rate::hz(10)] {
        let processor = Processor::new(frequency);
        simulated(&processor, &processor);
    }
}

#[test]
fn simulated_timers_that_begin_anew() {
    let processor = Processor::new(Rate::hz(1_000_000));
    simulated(&processor, &WrappingProcessor::<32>(processor.clone()));
    simulated(&processor, &WrappingProcessor::<24>(processor.clone()));
    simulated(&processor, &WrappingProcessor::<16>(processor.clone()));
    simulated(&processor, &WrappingProcessor::<8>(processor.clone()));
    assert!(Timer::now(&processor) > 1 << 17, "16 bits began anew twice");
}

#[cfg(all(feature = "critical-section-linux", target_os = "linux"))]
#[test]
fn timer_of_signals() {
    use condor_mos::linux::Signals;

    let signals = Signals::new();
    let interrupts = AtomicU32::new(0);
    let count = || {
        interrupts.fetch_add(1, Ordering::Relaxed);
    };
    let program = || {
        timer_conforms(
            &signals,
            || interrupts.load(Ordering::Relaxed),
            std::thread::yield_now,
        );
    };
    // SAFETY: the handler is one atomic addition.
    unsafe { signals.with_handler(count, program) }.unwrap();
}
