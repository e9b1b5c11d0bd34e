//! The doorbells of two processors in one core.

use core::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::{Clock, Doorbell, Instant, Processor};
use cortex_m::peripheral::{SCB, scb::VectActive};

use crate::{FOLLOWER, PROCESSORS};

/// The number of rings of each processor.
static RINGS: [AtomicU32; PROCESSORS] = [const { AtomicU32::new(0) }; PROCESSORS];

/// The doorbell of one of the two processors.
///
/// The leader is the background of the core, and the follower runs in its interrupts: to ring the follower
/// pends `PendSV`.
#[derive(Clone, Copy)]
pub(crate) struct Bell {
    pub(crate) me: Processor,
    /// Runs the processor that is not this one.
    pub(crate) run_other: fn(me: Processor),
}

impl Clock for Bell {
    fn now(&self) -> Instant {
        Instant::from_ns(firmware::now_ns())
    }
}

impl Doorbell for Bell {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        if let Some(rings) = RINGS.get(processor.index()) {
            critical_section::with(|_| {
                rings.store(
                    rings.load(Ordering::Relaxed).wrapping_add(1),
                    Ordering::Relaxed,
                );
            });
        }
        if processor == FOLLOWER {
            SCB::set_pendsv();
        }
    }

    fn prepare(&self) -> u32 {
        RINGS
            .get(self.me.index())
            .map_or(0, |rings| rings.load(Ordering::Relaxed))
    }

    fn wait(&self, seen: u32, _: Instant, _: Option<Processor>) {
        if SCB::vect_active() != VectActive::ThreadMode {
            // The interrupts of this core wait for us: run the other processor from here.
            (self.run_other)(self.me);
            return;
        }
        // With interrupts masked none can come between the look and the sleep, and the sleep
        // ends all the same. `SysTick` ends it in time for every deadline.
        cortex_m::interrupt::disable();
        if self.prepare() == seen {
            cortex_m::asm::wfi();
        }
        // SAFETY: in thread mode the mailbox waits outside of critical sections only.
        unsafe { cortex_m::interrupt::enable() };
    }
}
