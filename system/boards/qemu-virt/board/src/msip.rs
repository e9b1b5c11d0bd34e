//! [`Msip`]: the software interrupts, by which harts ring each other.

use condor_mbox::riscv::MsipDoorbell;
use condor_mbox::{Doorbell as _, Processor};
use qemu_virt_host::{Map, map};
use riscv::register::mhartid;

use crate::machine::{CLINT, MTIME_HZ};
use crate::memory::{LEAST_BYTES, memory};

/// As many as a machine has.
pub(crate) const HARTS: usize = map::HARTS as usize;

/// The harts, by their numbers.
const NUMBERS: [u16; HARTS] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];

/// The doorbell of a hart among harts, by the numbers of harts.
pub(crate) type Msip = MsipDoorbell<HARTS>;

const fn msip(hart: u8) -> Msip {
    // SAFETY: the machine has a CLINT there, with registers for more harts than these; they stay in
    // machine mode, and protect nothing but their stacks. Each uses its own doorbell.
    let bell = unsafe { Msip::new(CLINT, Processor(hart), NUMBERS, MTIME_HZ) };
    match bell {
        Some(bell) => bell,
        None => panic!("there are as many harts"),
    }
}

pub(crate) static MSIPS: [Msip; HARTS] = [
    msip(0),
    msip(1),
    msip(2),
    msip(3),
    msip(4),
    msip(5),
    msip(6),
    msip(7),
    msip(8),
    msip(9),
    msip(10),
    msip(11),
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
