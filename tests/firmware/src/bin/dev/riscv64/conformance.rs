//! The suites, on memory and on the lines of two boards.

use core::cell::Cell;

use condor_dev::conformance::{self, BusMemory};
use condor_dev::riscv::{GuardedMmio, Plic};
use condor_dev::{Bus as _, InterruptController, InterruptLevel, InterruptVector};
use firmware::Checks;

use super::map::{BUS, UART, UART_VECTOR};
use crate::memory::{BASE, MEMORY};

const UART_ENABLE: usize = UART + 1;
/// The serial port interrupts when it has room to send, as it always has here.
const HAS_ROOM: u8 = 1 << 1;
/// A clock whose alarm has passed.
const CLOCK: usize = 0x10_1000;
const CLOCK_VECTOR: u16 = 11;
const ALARM_LOW: usize = CLOCK + 0x08;
const ALARM_HIGH: usize = CLOCK + 0x0c;
const CLOCK_ENABLE: usize = CLOCK + 0x10;

/// Checks the guarded accesses, on memory.
pub(crate) fn bus(checks: &mut Checks) {
    // SAFETY: `fault` asks `on_fault`.
    let bus = unsafe { GuardedMmio::new(MEMORY.bus()) };
    let ground = BusMemory {
        memory: BASE + 0x500,
        absent: Some(BASE - 8),
        refuses_misaligned: true,
    };
    checks.same(conformance::bus(&bus, ground), Ok(()));
}

/// Checks the PLIC, which claims for the suite alone: nothing interrupts yet.
pub(crate) fn plic(checks: &mut Checks, plic: &Plic<GuardedMmio>) {
    let lines = Lines {
        plic,
        raised: [const { Cell::new(false) }; 2],
    };
    let verdict = conformance::interrupt_controller(
        &lines,
        [InterruptVector(UART_VECTOR), InterruptVector(CLOCK_VECTOR)],
        InterruptVector(0),
        |line, raised| lines.set(line, raised),
    );
    checks.same(verdict, Ok(()));
}

/// The PLIC with boards that drive their lines anew after each completion: QEMU 7.2's looks at a
/// line only then, and not, as the specification has it, when the gateway is free again.
struct Lines<'p> {
    plic: &'p Plic<GuardedMmio>,
    raised: [Cell<bool>; 2],
}

impl Lines<'_> {
    fn set(&self, line: InterruptVector, raised: bool) {
        let [serial, clock] = &self.raised;
        if line.0 == UART_VECTOR { serial } else { clock }.set(raised);
        self.drive(line);
    }

    fn drive(&self, line: InterruptVector) {
        let [serial, clock] = &self.raised;
        // The machine has both boards.
        let _ = if line.0 == UART_VECTOR {
            let enabled = if serial.get() { HAS_ROOM } else { 0 };
            BUS.write8(UART_ENABLE, 0)
                .and_then(|()| BUS.write8(UART_ENABLE, enabled))
        } else {
            BUS.write32(CLOCK_ENABLE, clock.get().into())
                .and_then(|()| BUS.write32(ALARM_HIGH, 0))
                .and_then(|()| BUS.write32(ALARM_LOW, 0))
        };
    }
}

impl InterruptController for Lines<'_> {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        self.plic.enable(vector, level);
    }

    fn disable(&self, vector: InterruptVector) {
        self.plic.disable(vector);
    }

    fn claim(&self) -> Option<InterruptVector> {
        self.plic.claim()
    }

    fn complete(&self, vector: InterruptVector) {
        self.plic.complete(vector);
        self.drive(vector);
    }
}
