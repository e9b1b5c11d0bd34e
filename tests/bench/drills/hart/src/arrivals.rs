//! Interrupts of boards that are memory, at random instants.
//!
//! [`Target`] has the drivers of the boards, a servo loop, and handlers of messages. [`Arrivals`] runs on another
//! hart: it simulates all boards, and compares their requests with what the target has served and counted. Both
//! run in real time, so that nobody knows in which order things happen. What is compared holds in any order.

mod raising;

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::time::Duration;

use condor_dev::{
    Attention, Bus, Driver, InterruptVector, Location, Registers, Switch, device_switch,
};
use condor_mbox::{Clock, Vector};
use condor_mos::Rate;
use condor_rt::{Machine, Program, ProgramError, Setup};

pub(crate) use raising::Arrivals;

/// A message that is counted, and has no reply.
const NOTE: Vector = Vector(11);
/// A message whose reply is the next number.
const ECHO: Vector = Vector(12);
/// A message with the number of a restart, in which the target enables its vectors again. The reply is the instant
/// when that was done: the low bits, in ns.
const RESTART: Vector = Vector(13);
/// A message whose reply is the number of runs of the loop.
const TICKS: Vector = Vector(14);
/// A message whose reply is the number of notes.
const NOTES: Vector = Vector(15);
/// A message whose reply is the number of interrupts.
const CLAIMS: Vector = Vector(16);
/// A message that names an interrupt vector of boards. The reply is how often it was disabled.
const STUCK: Vector = Vector(17);
/// A message that names an interrupt vector without a board. The reply is how often it interrupted.
const UNHANDLED: Vector = Vector(18);

/// The vector of one board.
const ALONE: u16 = 128;
/// The vector of two boards.
const SHARED: u16 = 130;
/// The vector of two boards, of which one gets stuck: it asks for ever.
const STICKING: u16 = 135;
/// The vector of one board, which withdraws requests. It is that of a serial port, which these harts do not have.
const FICKLE: u16 = 159;
/// Vectors without a board: as many as a program tells apart.
const STRANGERS: [u16; 8] = [129, 136, 137, 140, 143, 150, 156, 157];

/// The number of bytes on the bus that each board has.
const STRIDE: usize = 0x10;

/// The words of a board. The board writes `ASKED` and `HOLDS`, the driver writes the others.
mod word {
    /// The number of requests that the board has had.
    pub(super) const ASKED: usize = 0x0;
    /// The number of requests that the driver has served.
    pub(super) const SERVED: usize = 0x4;
    /// Not 0 while the board asks although it is served.
    pub(super) const HOLDS: usize = 0x8;
    /// The value of `HOLDS` that the driver has seen last.
    pub(super) const SEEN: usize = 0xc;
}

/// Words behind the boards, by which the two harts come to a restart at the same time.
mod restart {
    use super::STRIDE;

    /// The number of the restart for which the target is ready.
    pub(super) const TARGET: usize = 6 * STRIDE;
    /// The number of the restart for which the boards are ready.
    pub(super) const BOARDS: usize = TARGET + 0x4;
    /// The instant when the target began to enable its vectors: the low bits, in ns.
    pub(super) const BEGUN: usize = TARGET + 0x8;
}

/// The driver of a board.
struct Counting;

impl Driver for Counting {
    const NEW: Self = Self;

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        for word in [word::ASKED, word::SERVED, word::HOLDS, word::SEEN] {
            registers.write32(word, 0)?;
        }
        Ok(())
    }

    fn interrupt<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        let (asked, holds) = (
            registers.read32(word::ASKED)?,
            registers.read32(word::HOLDS)?,
        );
        if holds == 0 && asked == registers.read32(word::SERVED)? {
            return Ok(Attention::NotMine);
        }
        registers.write32(word::SEEN, holds)?;
        registers.write32(word::SERVED, asked)?;
        Ok(Attention::Mine)
    }
}

device_switch! {
    struct Boards {
        board: Counting = [
            Location::at(0).interrupting(ALONE, 1),
            Location::at(STRIDE).interrupting(SHARED, 2),
            Location::at(2 * STRIDE).interrupting(SHARED, 2),
            Location::at(3 * STRIDE).interrupting(STICKING, 3),
            Location::at(4 * STRIDE).interrupting(STICKING, 3),
            Location::at(5 * STRIDE).interrupting(FICKLE, 7),
        ],
    }
}

/// The time that a restart waits for the boards, which need much less unless they fail.
const MEETING: Duration = Duration::from_millis(100);
/// The time that the background sleeps.
const NAP: Duration = Duration::from_millis(1);
/// The number of turns that it then computes.
const TURNS: u32 = 20_000;

/// The program that is interrupted.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Target;

impl Program for Target {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let (bus, controller) = (machine.bus(), machine.interrupt_controller());
        let switch = Switch::<_, _, _, 0>::new(bus, controller, Boards::new());
        // The boards are there when the first message is answered.
        switch.start();
        let clock = machine.doorbell();
        let (ticks, notes) = (AtomicU32::new(0), AtomicU32::new(0));
        Setup::new(machine)?
            .console()?
            .interrupts(&switch)
            .on(NOTE, "note", &|_| notes.fetch_add(1, Relaxed))
            .on(ECHO, "echo", &|call| {
                compute(call.data() % 1024);
                call.data().wrapping_add(1)
            })
            .on(RESTART, "restart", &|call| {
                // Without the bus the boards would not have been found.
                let _ = meet(&machine.bus(), &clock, call.data());
                switch.start();
                now(&clock)
            })
            .on(TICKS, "ticks", &|_| ticks.load(Relaxed))
            .on(NOTES, "notes", &|_| notes.load(Relaxed))
            .on(CLAIMS, "claims", &|_| {
                let counts = switch.interrupt_counts();
                let claimed = counts.served.wrapping_add(counts.unclaimed);
                claimed.wrapping_add(counts.unhandled)
            })
            .on(STUCK, "stuck", &|call| {
                count_of(call.data(), switch.stuck())
            })
            .on(UNHANDLED, "unhandled", &|call| {
                count_of(call.data(), switch.unhandled())
            })
            .servo("loop", Rate::hz(1000), &mut |tick| {
                compute(tick.number % 16 * 100);
                ticks.fetch_add(1, Relaxed);
            })
            .background(|background| {
                // Interrupts come while it sleeps, and while it computes.
                while !background.is_stopping() {
                    background.serve(NAP)?;
                    compute(TURNS);
                }
                Ok(())
            })
    }
}

/// The count of a vector among those that are named; 0 if it is not one of them.
fn count_of(vector: u32, mut named: impl Iterator<Item = (InterruptVector, u32)>) -> u32 {
    let found = named.find(|(known, _)| u32::from(known.0) == vector);
    found.map_or(0, |(_, count)| count)
}

/// Waits until the boards are ready, too, and notes when that was.
fn meet<B: Bus>(bus: &B, clock: &impl Clock, restart: u32) -> Result<(), B::Error> {
    bus.write32(restart::TARGET, restart)?;
    let deadline = clock.now().after(MEETING);
    while bus.read32(restart::BOARDS)? != restart && clock.now() < deadline {}
    bus.write32(restart::BEGUN, now(clock))
}

/// The present instant: the low bits, in ns.
fn now(clock: &impl Clock) -> u32 {
    clock.now().as_ns() as u32
}

/// Computes for as many turns.
fn compute(turns: u32) {
    for turn in 0..turns {
        core::hint::black_box(turn);
    }
}
