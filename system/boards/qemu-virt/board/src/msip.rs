//! [`Msip`]: the software interrupts, by which harts ring each other.

use core::convert::identity;

use condor_mbox::riscv::MsipDoorbell;
use condor_mbox::{Doorbell as _, Processor};
use qemu_virt_host::{Map, map};
use riscv::register::mhartid;

use crate::machine::{CLINT, MTIME_HZ};
use crate::memory::{LEAST_BYTES, memory};

/// As many as a machine has.
pub(crate) const HARTS: usize = map::HARTS as usize;

/// An array with what a `const fn` makes of the number of each hart.
macro_rules! of_harts {
    ($make:path) => {
        [
            $make(0),
            $make(1),
            $make(2),
            $make(3),
            $make(4),
            $make(5),
            $make(6),
            $make(7),
            $make(8),
            $make(9),
            $make(10),
            $make(11),
        ]
    };
}
pub(crate) use of_harts;

/// The doorbell of a hart among harts, by the numbers of harts.
pub(crate) type Msip = MsipDoorbell<HARTS>;

const fn msip(hart: u8) -> Msip {
    // SAFETY: the machine has a CLINT there, with registers for more harts than these; they stay in
    // machine mode, and protect nothing but their stacks. Each uses its own doorbell.
    let bell = unsafe { Msip::new(CLINT, Processor(hart), of_harts!(identity), MTIME_HZ) };
    match bell {
        Some(bell) => bell,
        None => panic!("there are as many harts"),
    }
}

pub(crate) static MSIPS: [Msip; HARTS] = of_harts!(msip);

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
