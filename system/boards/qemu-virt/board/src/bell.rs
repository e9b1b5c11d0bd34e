//! [`HartBell`]: the doorbell of a hart, which rings harts by their software interrupts and the host by
//! the serial port.

use condor_mbox::riscv::MsipDoorbell;
use condor_mbox::{Clock, Doorbell, Instant, Processor};
use condor_rt::PROCESSORS;
use qemu_virt_host::{Map, map};
use riscv::register::{mhartid, time};

use crate::link;
use crate::machine::{CLINT, MTIME_HZ};
use crate::memory::{LEAST_BYTES, memory};

/// As many as a machine has.
pub(crate) const HARTS: usize = map::HARTS as usize;

/// The doorbell of a hart among harts, by the numbers of harts.
pub(crate) type Msip = MsipDoorbell<HARTS>;

const fn msip(hart: u8) -> Msip {
    // SAFETY: the machine has a CLINT there, with registers for more harts than these; they stay in
    // machine mode, and protect nothing but their stacks. Each uses its own doorbell.
    let bell = unsafe { Msip::new(CLINT, Processor(hart), [0, 1, 2, 3, 4, 5, 6, 7], MTIME_HZ) };
    match bell {
        Some(bell) => bell,
        None => panic!("there are as many harts"),
    }
}

static MSIPS: [Msip; HARTS] = [
    msip(0),
    msip(1),
    msip(2),
    msip(3),
    msip(4),
    msip(5),
    msip(6),
    msip(7),
];

/// Rings the hart that is this processor, if one is.
pub(crate) fn ring_processor(number: u8) {
    let map = Map::read(&memory(LEAST_BYTES));
    let hart = map.as_ref().ok().and_then(|map| map.hart_of(number));
    if let Some(hart) = hart {
        ring_hart(hart as usize);
    }
}

/// Rings a hart.
pub(crate) fn ring_hart(hart: usize) {
    if let Some(bell) = of(mhartid::read()) {
        bell.ring(Processor(hart as u8));
    }
}

/// That of a hart.
pub(crate) fn of(hart: usize) -> Option<&'static Msip> {
    MSIPS.get(hart)
}

/// The doorbell of a hart, and the clock that all harts share. Copies are the same doorbell.
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
