//! Counts the instructions that releases, messages and interrupts cost this hart.
//!
//! The machine must run with `-icount shift=0`, where `minstret` counts one for every instruction and a
//! trap takes none. The cost of interrupts is found by a background that knows how many instructions it
//! runs itself; sequences and a trap handler of known length are counted first, in the same ways.
#![allow(clippy::inline_always, reason = "a call would be counted, too")]

use core::arch::{asm, global_asm};
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;

use board::{Hart, MTIME};
use condor_dev::device_switch;
use condor_dev::{Attention, Bus, Driver, InterruptVector, Location, OpenMode, Registers, Switch};
use condor_mbox::{Call, Exclusion as _, Messenger, Vector};
use condor_mos::{ClockSpec, EventTable, LoopId, Loops, Overrun, Rate, Scheduler, Timer as _};
use condor_rt::{Machine as _, MailboxOf, ProgramError, Raiser, Setup};
use drills::WRONG;
use drills::instructions::{Counts, NAME};

const LOOPS: usize = 3;
const RATES: [Rate; LOOPS] = [Rate::hz(400), Rate::hz(100), Rate::hz(50)];
/// Events of the fastest loop in a hyperperiod, and releases of all loops.
const EVENTS: usize = 8;
const RELEASES: u32 = 11;

/// Hyperperiods, and messages, before anything is measured: what is done only once is then over.
const WARM_UP: u32 = 3;
const HYPERPERIODS: u32 = 20;
const MESSAGES: u32 = 1000;

/// Instructions between two reads of the counter.
const SEQUENCE: u32 = 1000;
/// Instructions of the trap handler below.
const HANDLER: u32 = 14;
const HANDLER_RUNS: u32 = 300;
/// Ticks until the handler is run.
const AHEAD: u64 = 20;
/// The timer's bit of `mie`.
const TIMER: usize = 1 << 7;

const INTERRUPTS: u32 = 1000;
/// The vector of the board that interrupts.
const VECTOR: InterruptVector = InterruptVector(150);

const INCREMENT: Vector = Vector(12);
const PATIENCE: Duration = Duration::from_secs(1);

/// The number of runs of each loop; the trap handler counts as the first.
static RUNS: [AtomicU32; LOOPS] = [const { AtomicU32::new(0) }; LOOPS];

// Counts a run, and disables the timer's interrupt.
global_asm!(
    ".balign 4",
    "condor_counted_trap:",
    "addi sp, sp, -16",
    "sd t0, 0(sp)",
    "sd t1, 8(sp)",
    ".option push",
    ".option norelax",
    "lla t0, {runs}",
    ".option pop",
    "lw t1, 0(t0)",
    "addi t1, t1, 1",
    "sw t1, 0(t0)",
    "li t0, {timer}",
    "csrc mie, t0",
    "ld t0, 0(sp)",
    "ld t1, 8(sp)",
    "addi sp, sp, 16",
    "mret",
    runs = sym RUNS,
    timer = const TIMER,
);

/// Counts, and publishes what came out.
pub(crate) fn run(hart: &Hart) -> Result<(), ProgramError> {
    // Its own mailbox and loops: what they take alone is counted.
    let mut publisher = Setup::new(hart)?.publish::<Counts>(NAME)?;
    let mut counts = Counts::default();
    known(hart, &mut counts);
    releases(hart, &mut counts)?;

    let increment = |call: &Call<'_>| call.data().wrapping_add(1);
    let mut mailbox = hart.mailbox()?;
    mailbox.set_vector(INCREMENT, &increment, "increment")?;
    mailbox.join()?;
    messages(hart, &mailbox, &mut counts)?;
    interrupts(hart, &mut counts)?;
    publisher.publish(&counts)?;
    Ok(())
}

/// Counts a sequence and a trap handler whose lengths are known beforehand.
fn known(hart: &Hart, counts: &mut Counts) {
    let (first, last): (u64, u64);
    // SAFETY: the counter can be read in machine mode.
    unsafe {
        asm!(
            "csrr {first}, minstret",
            ".rept {sequence}",
            "nop",
            ".endr",
            "csrr {last}, minstret",
            first = out(reg) first,
            last = out(reg) last,
            sequence = const SEQUENCE,
            options(nostack),
        );
    }
    counts.sequence = SEQUENCE + 1;
    counts.sequence_counted = last.wrapping_sub(first) as u32;

    let (vector, enabled): (usize, usize);
    // SAFETY: nothing is enabled until the timer's interrupt is, and the handler changes nothing but
    // a count and `mie`.
    unsafe {
        asm!(
            "csrrw {enabled}, mie, zero",
            "lla {vector}, condor_counted_trap",
            "csrrw {vector}, mtvec, {vector}",
            vector = out(reg) vector,
            enabled = out(reg) enabled,
            options(nostack),
        );
    }
    let clint = hart.platform();
    for run in 1..=HANDLER_RUNS {
        let _ = clint.arm(clint.now().wrapping_add(AHEAD));
        // SAFETY: the handler is there.
        unsafe { asm!("csrs mie, {timer}", timer = in(reg) TIMER, options(nostack)) };
        let taken = taken_until(&RUNS[0], run);
        counts.handler_counted = counts.handler_counted.wrapping_add(taken);
    }
    clint.disarm();
    // SAFETY: as it was.
    unsafe {
        asm!(
            "csrw mtvec, {vector}",
            "csrw mie, {enabled}",
            vector = in(reg) vector,
            enabled = in(reg) enabled,
            options(nostack),
        );
    }
    counts.handler = HANDLER;
    counts.handler_runs = HANDLER_RUNS;
    RUNS[0].store(0, Ordering::Relaxed);
}

/// Counts the instructions that releases take from the background.
fn releases(hart: &Hart, counts: &mut Counts) -> Result<(), ProgramError> {
    let table = EventTable::<LOOPS, EVENTS>::try_new(&RATES, ClockSpec::of::<u64>(MTIME))?;
    let scheduler: Scheduler<_, LOOPS, EVENTS> = Scheduler::new(hart.platform(), table);
    let mut fast = |_| body::<0>();
    let mut middle = |_| body::<1>();
    let mut slow = |_| body::<2>();
    scheduler.scope(|scope| {
        scope.assign(LoopId(0), Overrun::Skip, &mut fast)?;
        scope.assign(LoopId(1), Overrun::Skip, &mut middle)?;
        scope.assign(LoopId(2), Overrun::Skip, &mut slow)?;
        let background = || {
            let [.., slowest] = &RUNS;
            let runs = || {
                RUNS.iter()
                    .map(|runs| runs.load(Ordering::Relaxed))
                    .sum::<u32>()
            };
            // When the slowest loop has run, all of a hyperperiod's first instant has.
            taken_until(slowest, WARM_UP);
            let before = runs();
            counts.releases_counted = taken_until(slowest, WARM_UP + HYPERPERIODS);
            counts.releases = runs().wrapping_sub(before);
        };
        Ok::<_, ProgramError>(scheduler.run(background)?)
    })?;
    counts.hyperperiods = HYPERPERIODS;
    counts.releases_each = RELEASES;
    counts.body = BODY;
    Ok(())
}

/// Counts the instructions of messages of the hart to itself.
fn messages(
    hart: &Hart,
    mailbox: &MailboxOf<'_, Hart>,
    counts: &mut Counts,
) -> Result<(), ProgramError> {
    let me = hart.number();
    for message in 0..WARM_UP + MESSAGES {
        let begun = counter();
        let sent = mailbox.send(me, INCREMENT, message, Duration::ZERO);
        let served = mailbox.serve(Duration::ZERO);
        let sent_and_served = since(begun);
        let begun = counter();
        let reply = mailbox.send_with_reply(me, INCREMENT, message, PATIENCE);
        let replied = since(begun);
        sent?;
        if served? != 1 || reply? != message.wrapping_add(1) {
            return Err(ProgramError::program(&WRONG));
        }
        if message >= WARM_UP {
            counts.messages = counts.messages.wrapping_add(1);
            counts.messages_counted = counts.messages_counted.wrapping_add(sent_and_served);
            counts.replies_counted = counts.replies_counted.wrapping_add(replied);
        }
    }
    Ok(())
}

/// A board whose driver reads the counter first of all.
struct Counter {
    entered: AtomicU32,
}

impl Driver for Counter {
    const NEW: Self = Self {
        entered: AtomicU32::new(0),
    };

    fn probe<B: Bus>(_: Registers<'_, B>) -> bool {
        true
    }

    fn interrupt<B: Bus>(&self, _: Registers<'_, B>) -> Result<Attention, B::Error> {
        self.entered.store(counter() as u32, Ordering::Relaxed);
        Ok(Attention::Mine)
    }
}

device_switch! { struct Boards { counter: Counter = [Location::at(0).interrupting(VECTOR.0, 1)] } }

/// Counts the instructions from the one that is interrupted to the first one of a driver.
fn interrupts(hart: &Hart, counts: &mut Counts) -> Result<(), ProgramError> {
    let (bus, controller) = (hart.bus(), hart.interrupt_controller());
    let switch = Switch::<_, _, _, 1>::new(bus, controller, Boards::new());
    switch.start();
    let raiser = Raiser::new(hart);
    let board = switch.open_typed(Boards::counter, 0, OpenMode::READ);
    let board = board.map_err(|error| ProgramError::program(&error))?;
    hart.with_interrupts(&switch, || {
        for interrupt in 0..WARM_UP + INTERRUPTS {
            // The interrupt comes as soon as it may.
            let begun = hart.exclusion().with(|| {
                raiser.raise(hart.number(), VECTOR);
                counter()
            });
            let entered = board.entered.swap(0, Ordering::Relaxed);
            if interrupt >= WARM_UP && entered != 0 {
                let taken = entered.wrapping_sub(begun as u32).wrapping_sub(1);
                counts.interrupts = counts.interrupts.wrapping_add(1);
                counts.interrupts_counted = counts.interrupts_counted.wrapping_add(taken);
            }
        }
    })
}

/// Instructions of [`body`].
const BODY: u32 = 5;

/// Counts a run of a loop. It brings its address along, so that its length depends on no compiler.
#[expect(clippy::inline_always, reason = "a call would be counted, too")]
#[inline(always)]
fn body<const LOOP: usize>() {
    const { assert!(LOOP < LOOPS) };
    // SAFETY: the word is one of `RUNS`, which only its own loop writes.
    unsafe {
        asm!(
            ".option push",
            ".option norelax",
            "lla {at}, {runs} + {place}",
            ".option pop",
            "lw {count}, 0({at})",
            "addi {count}, {count}, 1",
            "sw {count}, 0({at})",
            runs = sym RUNS,
            place = const LOOP * size_of::<AtomicU32>(),
            at = out(reg) _,
            count = out(reg) _,
            options(nostack),
        );
    }
}

/// Turns until a loop has run so many times, and says how many instructions others took meanwhile.
#[inline(never)]
fn taken_until(runs: &AtomicU32, number: u32) -> u32 {
    /// Instructions of a turn, and besides turns.
    const TURN: u64 = 3;
    const ELSE: u64 = 1;
    let (first, last, turns): (u64, u64, u64);
    // SAFETY: the counter can be read in machine mode, and the address is that of a word.
    unsafe {
        asm!(
            "csrr {first}, minstret",
            "2:",
            "lw {now}, 0({address})",
            "addi {turns}, {turns}, 1",
            "bne {now}, {number}, 2b",
            "csrr {last}, minstret",
            first = out(reg) first,
            last = out(reg) last,
            now = out(reg) _,
            turns = inout(reg) 0_u64 => turns,
            address = in(reg) runs.as_ptr(),
            number = in(reg) i64::from(number.cast_signed()),
            options(nostack),
        );
    }
    let own = TURN.wrapping_mul(turns).wrapping_add(ELSE);
    last.wrapping_sub(first).wrapping_sub(own) as u32
}

/// Reads the counter, which counts this read, too.
#[expect(clippy::inline_always, reason = "a call would be counted, too")]
#[inline(always)]
fn counter() -> u64 {
    let count;
    // SAFETY: the counter can be read in machine mode.
    unsafe { asm!("csrr {count}, minstret", count = out(reg) count, options(nostack)) };
    count
}

/// Returns the number of instructions since a read of the counter, and before this one.
#[expect(clippy::inline_always, reason = "a call would be counted, too")]
#[inline(always)]
fn since(begun: u64) -> u32 {
    counter().wrapping_sub(begun).wrapping_sub(1) as u32
}
