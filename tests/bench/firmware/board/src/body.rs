//! The body of a loop, which is the same for all schedulers.

use core::arch::asm;
use core::sync::atomic::{AtomicU32, Ordering};

use crate::LOOPS;
use crate::timer::COUNTER_VALUE;

/// The count of a loop's runs and the time of the last one, which its body stores.
#[derive(Debug)]
#[repr(C)]
pub struct Trace {
    /// The counter at the start of the last run, as read: it counts down.
    counter: AtomicU32,
    /// The number of runs of the loop.
    runs: AtomicU32,
}

impl Trace {
    /// Returns the time at which the last run began, in ticks.
    #[must_use]
    pub fn began(&self) -> u32 {
        // One core: what an interrupt has stored is there.
        !self.counter.load(Ordering::Relaxed)
    }

    /// Returns the number of runs of the loop.
    #[must_use]
    pub fn runs(&self) -> u32 {
        // One core: what an interrupt has stored is there.
        self.runs.load(Ordering::Relaxed)
    }

    /// Returns the address of the number of runs, for the background, whose turns have a known length.
    pub(crate) fn runs_address(&self) -> *const u32 {
        self.runs.as_ptr()
    }
}

/// The traces of the loops, the fastest first.
pub static TRACES: [Trace; LOOPS] = [const {
    Trace {
        counter: AtomicU32::new(0),
        runs: AtomicU32::new(0),
    }
}; LOOPS];

/// The number of instructions of [`body`].
pub const INSTRUCTIONS: u32 = 9;

/// The text of the body for the loop at `{trace}` bytes of `{traces}`, with the counter at
/// `{counter}`. It needs `r2` and `r3`, and it brings its addresses along, so that its length
/// depends on no compiler.
#[macro_export]
macro_rules! body_text {
    () => {
        "movw r3, #:lower16:({counter})
         movt r3, #:upper16:({counter})
         ldr r3, [r3]
         movw r2, #:lower16:({traces} + {trace})
         movt r2, #:upper16:({traces} + {trace})
         str r3, [r2]
         ldr r3, [r2, #4]
         add r3, r3, #1
         str r3, [r2, #4]"
    };
}

/// Reads the counter and counts the run.
#[inline(always)]
pub fn body<const LOOP: usize>() {
    const { assert!(LOOP < LOOPS) };
    // SAFETY: the counter is a register that can be read, and the words are those of a trace,
    // which only its own loop writes.
    unsafe {
        asm!(
            crate::body_text!(),
            counter = const COUNTER_VALUE,
            traces = sym TRACES,
            trace = const LOOP * size_of::<Trace>(),
            out("r2") _,
            out("r3") _,
            options(nostack, preserves_flags),
        );
    }
}
