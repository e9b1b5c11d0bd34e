//! The device switch on hardware that nobody here wrote: boards that are there and boards that are
//! not, and a serial port that interrupts through a PLIC.
//!
//! It makes the calls of [`dev_exercise`], looks for its own boards by real access faults, and then
//! says `echo` and a number: so many bytes it gives back as they come.
#![no_std]
#![no_main]

#[cfg(feature = "conformance")]
mod conformance;
mod echo;
mod machine;

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use checks::Checks;

use condor_dev::drivers::Uart16550;
use condor_dev::riscv::{GuardedMmio, Plic, on_fault};
use condor_dev::{
    Bus as _, BusErrorKind, Location, Mode, NoInterrupts, OpenError, Presence, Switch,
    device_switch,
};
use dev_exercise::{Boards, Devices, Memory};
use machine::{BUS, NOWHERE, UART, UART_VECTOR, VIRTIO, plic, print, switch_off};
use riscv::register::{mie, mstatus};
use utah_mit_boards::Adc16;

// No floating point: it is off, and using it traps.
core::arch::global_asm!(
    include_str!("../../one-hart.s"),
    include_str!("trap.s"),
    mstatus = const 0
);

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
static MEMORY: Memory = Memory::new();
static EXERCISED: Devices<NoInterrupts> = Switch::new(MEMORY.bus(), NoInterrupts, Boards::new());
/// Accesses that nothing answered.
static FAULTS: AtomicU32 = AtomicU32::new(0);

const EXTERNAL_INTERRUPT: usize = 1 << (usize::BITS - 1) | 0xb;

/// Where the hart comes from `one-hart.s`.
#[unsafe(no_mangle)]
extern "C" fn main() {
    let mut checks = Checks::new(&print);
    let exercised = dev_exercise::everything(&mut checks, &EXERCISED, MEMORY.bus());
    checks.same("memory answers as boards do", exercised, Ok(()));
    checks.group("a bus whose faults are caught");
    #[cfg(feature = "conformance")]
    conformance::bus(&mut checks);
    faults(&mut checks);
    checks.group("a PLIC");
    let plic = plic();
    checks.same("it is reset", plic.reset(), Ok(()));
    #[cfg(feature = "conformance")]
    conformance::plic(&mut checks, &plic);
    checks.group("boards that are there, and boards that are not");
    start(&mut checks);
    // SAFETY: the trap entry is set up, and no critical section is in progress.
    unsafe {
        mie::set_mext();
        mstatus::set_mie();
    }
    checks.group("a serial port that interrupts");
    echo::echo(&mut checks, &SYSTEM);
    may_panic(usize::from(UART_VECTOR));
    switch_off(checks.conclude());
}

fn faults(checks: &mut Checks<'_>) {
    let silent = |result: Result<(), condor_dev::AccessError>| {
        result.map_err(|error| error.kind) == Err(BusErrorKind::NoAnswer)
    };
    checks.that("a byte is not read", silent(BUS.read8(NOWHERE).map(drop)));
    checks.that("nor two", silent(BUS.read16(NOWHERE).map(drop)));
    checks.that("nor four", silent(BUS.read32(NOWHERE).map(drop)));
    checks.that("a byte is not written", silent(BUS.write8(NOWHERE, 1)));
    checks.that("nor two", silent(BUS.write16(NOWHERE, 1)));
    checks.that("nor four", silent(BUS.write32(NOWHERE, 1)));
    checks.same("each was a fault", FAULTS.load(Ordering::Relaxed), 6);
}

fn start(checks: &mut Checks<'_>) {
    SYSTEM.start();
    checks.same(
        "so was each absent board",
        FAULTS.load(Ordering::Relaxed),
        8,
    );
    for (name, board) in [("uart", 1), ("adc", 0), ("adc", 1)] {
        let absent = OpenError::NotPresent {
            name,
            board,
            presence: Presence::Absent,
        };
        let opened = SYSTEM.open(name, board, Mode::READ);
        checks.same("there is no other board", opened, Err(absent));
    }
}

/// Every trap comes here, with interrupts masked; gives where to go on.
#[unsafe(no_mangle)]
extern "C" fn trap(cause: usize, instruction: usize) -> usize {
    if cause == EXTERNAL_INTERRUPT {
        SYSTEM.on_interrupt();
        return instruction;
    }
    if let Some(end) = on_fault(cause, instruction) {
        let faults = FAULTS.load(Ordering::Relaxed).wrapping_add(1);
        FAULTS.store(faults, Ordering::Relaxed);
        return end;
    }
    print("an exception, or an interrupt that nobody enabled\n");
    switch_off(false)
}

/// Panics, if built to: the search for panicking paths must find this one.
fn may_panic(index: usize) {
    if cfg!(feature = "panicking") {
        let table = core::hint::black_box([0_u8; 4]);
        core::hint::black_box(table[core::hint::black_box(index)]);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        print("panic in ");
        print(place.file());
        print("\n");
    }
    condor_firmware_panicked()
}

/// The name that is searched for in the linked image: it is there only if something can panic.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_firmware_panicked() -> ! {
    switch_off(false)
}
