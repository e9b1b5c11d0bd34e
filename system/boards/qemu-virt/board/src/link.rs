//! The serial port as the line between host and harts: a byte is the number of a processor that is
//! rung.
//!
//! There is one port, and any hart may ring any process of the host. A word that all harts share
//! has a bit for each processor to be rung; the hart that holds the port sends the numbers of the
//! set bits. No hart waits for the port: while it is full, bits stay set, and its interrupt has
//! them sent.
//!
//! [`Line`] is the driver of the port's interrupt alone. The bytes do not go through that of a serial
//! port, [`Uart16550`](condor_dev::drivers::Uart16550): its buffers belong to one program, and this port to
//! all harts, whatever they run.

use core::sync::atomic::{AtomicU32, Ordering};

use condor_dev::{Attention, Bus, Driver, Mmio, Registers};
use qemu_virt_host::map;

use crate::machine::{RAM, UART, UART_BYTES};
use crate::msip;

const DATA: usize = UART;
const INTERRUPTS: usize = UART + 1;
const FIFO: usize = UART + 2;
const REASON: usize = UART + 2;
const STATUS: usize = UART + 5;

const RECEIVED: u8 = 1 << 0;
const SENT: u8 = 1 << 1;
const FIFO_ON: u8 = 0b111;
const NO_REASON: u8 = 1 << 0;
const READY: u8 = 1 << 0;
const EMPTY: u8 = 1 << 5;

// SAFETY: the machine has a 16550 there, whose registers have one byte.
pub(crate) static PORT: Mmio = unsafe { Mmio::new(UART, UART_BYTES) };

/// Words that all harts share.
#[repr(C)]
struct Shared {
    /// A bit for each processor to be rung.
    wanted: AtomicU32,
    /// Whether a hart holds the port.
    held: AtomicU32,
}

fn shared() -> &'static Shared {
    let address = RAM + (map::AT + map::BOARD) as usize;
    // SAFETY: the map leaves this place to the harts, which access it as these atomics alone.
    unsafe { &*(address as *const Shared) }
}

fn read(register: usize) -> u8 {
    // The range has the register.
    PORT.read8(register).unwrap_or(0)
}

fn write(register: usize, value: u8) {
    let _ = PORT.write8(register, value);
}

/// Makes the port ready, for all harts: nothing was sent yet.
pub(crate) fn reset() {
    write(FIFO, FIFO_ON);
    write(INTERRUPTS, RECEIVED);
}

/// Rings a process of the host.
pub(crate) fn ring(number: u8) {
    // Orders the stores for the process before the ring; and pairs with the loads in `send`.
    riscv::asm::fence();
    shared()
        .wanted
        .fetch_or(1 << (number % 32), Ordering::SeqCst);
    send();
}

/// Sends as much as the port takes of what is wanted.
pub(crate) fn send() {
    let Shared { wanted, held } = shared();
    critical_section::with(|_| {
        // Of those who come while the port is held, its holder sends: it looks once more after it has
        // let go, and each bit is set before its setter finds the port held.
        while wanted.load(Ordering::SeqCst) != 0 && held.swap(1, Ordering::SeqCst) == 0 {
            let full = send_held(wanted);
            held.store(0, Ordering::SeqCst);
            if full {
                break;
            }
        }
    });
}

/// Sends, as the holder of the port; whether it is full.
fn send_held(wanted: &AtomicU32) -> bool {
    loop {
        let bits = wanted.load(Ordering::SeqCst);
        if bits == 0 {
            write(INTERRUPTS, RECEIVED);
            return false;
        }
        if read(STATUS) & EMPTY == 0 {
            write(INTERRUPTS, RECEIVED | SENT);
            // The port may have become empty before its interrupt was on.
            if read(STATUS) & EMPTY == 0 {
                return true;
            }
        }
        let number = bits.trailing_zeros();
        wanted.fetch_and(!(1 << number), Ordering::SeqCst);
        write(DATA, number as u8);
    }
}

/// Iterates over the bytes that the host has sent: the numbers of processors that it rings.
fn received() -> impl Iterator<Item = u8> {
    core::iter::from_fn(|| (read(STATUS) & READY != 0).then(|| read(DATA)))
}

/// The port as a board that interrupts: passes on what it has received, and sends what had no room.
#[derive(Debug)]
pub(crate) struct Line(());

impl Driver for Line {
    const NEW: Self = Self(());
    const READS: bool = false;
    const WRITES: bool = false;

    /// The port exists; to read its first register would take a byte from it.
    fn probe<B: Bus>(_: Registers<'_, B>) -> bool {
        true
    }

    fn interrupt<B: Bus>(&self, _: Registers<'_, B>) -> Result<Attention, B::Error> {
        if read(REASON) & NO_REASON != 0 {
            return Ok(Attention::NotMine);
        }
        received().for_each(msip::ring_processor);
        send();
        Ok(Attention::Mine)
    }
}
