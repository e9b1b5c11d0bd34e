//! Boards that are there and boards that are not, and a serial port that interrupts through a PLIC.
//!
//! The switch looks for its boards by real access faults. Then the program prints `echo` and a number, and sends
//! back that many bytes as they come.

#[cfg(feature = "conformance")]
mod conformance;
mod echo;
mod map;

use core::sync::atomic::{AtomicU32, Ordering};

use condor_dev::drivers::Uart16550;
use condor_dev::riscv::{GuardedMmio, Plic, on_fault};
use condor_dev::{
    Bus as _, BusErrorKind, Location, OpenError, OpenMode, Presence, Switch, device_switch,
};
use firmware::{Checks, print, switch_off};
use map::{BUS, NOWHERE, UART, UART_VECTOR, VIRTIO, plic};
use riscv::interrupt::{Exception, Interrupt};
use riscv::register::{mcause, mepc, mie, mstatus};
use riscv_rt::{TrapFrame, core_interrupt, exception};
use utah_mit_boards::Adc16;

/// The serial port of the machine.
type Serial = Uart16550<1, 256>;

device_switch! {
    /// What this machine might have.
    struct Machine {
        uart: Serial = [
            Location::at(UART).interrupting(UART_VECTOR, 1),
            Location::at(NOWHERE).interrupting(UART_VECTOR, 1),
        ],
        adc: Adc16 = [Location::at(NOWHERE + 0x1000), Location::at(VIRTIO)],
    }
}

/// The switch of this machine, with as many descriptors.
type System = Switch<GuardedMmio, Plic<GuardedMmio>, Machine, 4>;

static SYSTEM: System = Switch::new(BUS, plic(), Machine::new());
/// Accesses that nothing answered.
static FAULTS: AtomicU32 = AtomicU32::new(0);

/// Checks the machine's bus, its PLIC and its serial port.
pub(crate) fn devices(checks: &mut Checks) {
    checks.group("a bus whose faults are caught");
    #[cfg(feature = "conformance")]
    conformance::bus(checks);
    faults(checks);
    checks.group("a PLIC");
    let plic = plic();
    checks.same(plic.reset(), Ok(()));
    #[cfg(feature = "conformance")]
    conformance::plic(checks, &plic);
    checks.group("boards that are there, and boards that are not");
    start(checks);
    // SAFETY: the handlers are below, and no critical section is in progress.
    unsafe {
        mie::set_mext();
        mstatus::set_mie();
    }
    checks.group("a serial port that interrupts");
    echo::echo(checks, &SYSTEM);
}

fn faults(checks: &mut Checks) {
    let silent = |result: Result<(), condor_dev::BusAccessError>| {
        result.map_err(|error| error.kind) == Err(BusErrorKind::NoAnswer)
    };
    checks.that(silent(BUS.read8(NOWHERE).map(drop)));
    checks.that(silent(BUS.read16(NOWHERE).map(drop)));
    checks.that(silent(BUS.read32(NOWHERE).map(drop)));
    checks.that(silent(BUS.write8(NOWHERE, 1)));
    checks.that(silent(BUS.write16(NOWHERE, 1)));
    checks.that(silent(BUS.write32(NOWHERE, 1)));
    checks.same(FAULTS.load(Ordering::Relaxed), 6);
}

fn start(checks: &mut Checks) {
    SYSTEM.start();
    checks.same(FAULTS.load(Ordering::Relaxed), 8);
    for (name, board) in [("uart", 1), ("adc", 0), ("adc", 1)] {
        let absent = OpenError::NotPresent {
            name,
            board,
            presence: Presence::Absent,
        };
        checks.same(SYSTEM.open(name, board, OpenMode::READ), Err(absent));
    }
}

#[core_interrupt(Interrupt::MachineExternal)]
fn interrupt() {
    SYSTEM.on_interrupt();
}

#[exception(Exception::LoadFault)]
fn load_fault(_: &TrapFrame) {
    fault();
}

#[exception(Exception::StoreFault)]
fn store_fault(_: &TrapFrame) {
    fault();
}

/// Goes on where the access says, if it was one of the guarded bus.
fn fault() {
    let Some(end) = on_fault(mcause::read().bits(), mepc::read()) else {
        print("an access outside of the bus\n");
        switch_off(false);
    };
    let faults = FAULTS.load(Ordering::Relaxed).wrapping_add(1);
    FAULTS.store(faults, Ordering::Relaxed);
    // SAFETY: the access ends there, and the trap entry does not write `mepc`.
    unsafe { mepc::write(end) };
}
