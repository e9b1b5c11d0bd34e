//! [`HartBell`]: the doorbell of a hart, which rings harts by their software interrupts and the host by
//! the serial port.

use condor_mbox::{Clock, Doorbell, Instant, Processor};
use condor_rt::PROCESSORS;
use qemu_virt_host::Map;
use riscv::register::time;

use crate::link;
use crate::machine::MTIME_HZ;
use crate::msip::Msip;

/// The [`Doorbell`] of a hart, by which it wakes other processors for a message and is woken itself. It is also the
/// hart's [`Clock`], which all harts share. Copies are the same doorbell.
#[derive(Clone, Copy, Debug)]
pub struct HartBell {
    msip: &'static Msip,
    /// Which hart a processor is.
    harts: [Option<Processor>; PROCESSORS],
}

impl HartBell {
    pub(crate) fn new(msip: &'static Msip, map: &Map) -> Self {
        let mut harts = [None; PROCESSORS];
        for (number, hart) in (0..).zip(&mut harts) {
            *hart = map.hart_of(number).map(|hart| Processor(hart as u8));
        }
        Self { msip, harts }
    }
}

impl Clock for HartBell {
    /// By the hart's own view of `mtime`: an access to the device takes far longer, and harts wait for
    /// each other there.
    #[inline]
    fn now(&self) -> Instant {
        const NS: u64 = 1_000_000_000 / MTIME_HZ.get() as u64;
        Instant::from_ns(time::read64().wrapping_mul(NS))
    }
}

impl Doorbell for HartBell {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        match self.harts.get(processor.index()) {
            Some(Some(hart)) => self.msip.ring(*hart),
            Some(None) => link::ring(processor.0),
            None => {}
        }
    }

    fn prepare(&self) -> u32 {
        self.msip.prepare()
    }

    fn wait(&self, seen: u32, until: Instant, whom: Option<Processor>) {
        self.msip.wait(seen, until, whom);
    }
}
