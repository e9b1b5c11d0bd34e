//! Counts sequences of known length in the ways in which schedulers are measured.
//!
//! It prints what [`board`] explains: ticks of a sequence without and with interrupts, and how
//! long after the instant of an alarm the first instruction of a handler comes.
#![no_std]
#![no_main]

use core::arch::{asm, naked_asm};

use board::background::until;
use board::body::{self, TRACES, Trace};
use board::report::{is_shared, line};
use board::{Interrupt, PERIODS, body_text, switch_off, timer};
use cortex_m::peripheral::NVIC;

/// Instructions between two reads of the counter.
const NOPS: u32 = 1000;

/// Interrupts of a handler of known length.
const INTERRUPTS: u32 = 550;

/// Instructions of [`TIMER0`] besides the body: five, and a return.
const HANDLER: u32 = body::INSTRUCTIONS + 6;

/// Alarms that are looked at.
const ALARMS: u32 = 300;

/// Nothing that is armed is nearer, or arming would be too late for it.
const AHEAD: u32 = 2_000;

/// Runs the body, withdraws the alarm and does not arm it again.
// SAFETY: the name is that of the interrupt in the vector table, and only the hardware calls it.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn TIMER0() {
    naked_asm!(
        body_text!(),
        "movs r1, #1",
        "movw r2, #:lower16:({status})",
        "movt r2, #:upper16:({status})",
        "str r1, [r2]",
        "nop",
        "bx lr",
        counter = const timer::COUNTER_VALUE,
        traces = sym TRACES,
        trace = const 0,
        status = const timer::ALARM_STATUS,
    )
}

#[cortex_m_rt::entry]
fn main() -> ! {
    timer::stop_at_zero();
    timer::start();
    // SAFETY: no lock relies on a priority.
    unsafe { NVIC::unmask(Interrupt::TIMER0) };
    line("hertz", timer::HERTZ);
    line("nops", NOPS + 1);
    line("nops_ticks", nops());
    handler();
    alarm();
    switch_off(true)
}

/// Ticks between two reads of the counter, with the nops and the second read between them.
fn nops() -> u32 {
    let (first, last): (u32, u32);
    // SAFETY: the counter's register can be read.
    unsafe {
        asm!(
            "ldr {first}, [{counter}]",
            ".rept {nops}",
            "nop",
            ".endr",
            "ldr {last}, [{counter}]",
            first = out(reg) first,
            last = out(reg) last,
            counter = in(reg) timer::COUNTER_VALUE,
            nops = const NOPS,
            options(nostack, readonly),
        );
    }
    first.wrapping_sub(last)
}

/// Measures the background with a handler of known length in between, as the schedulers are measured.
fn handler() {
    let trace = &TRACES[0];
    let (mut ticks, mut background) = (0, 0);
    for _ in 0..INTERRUPTS {
        timer::arm(timer::now().wrapping_add(AHEAD));
        let passed = until(trace, trace.runs() + 1);
        ticks += passed.ticks;
        background += passed.own_instructions;
    }
    line("handler", HANDLER);
    line("handler_interrupts", INTERRUPTS);
    line("handler_ticks", ticks);
    line("handler_background_instructions", background);
}

/// Measures the lateness of the first instruction of a handler.
fn alarm() {
    let trace: &Trace = &TRACES[0];
    let (mut sum, mut least, mut most) = (0, u32::MAX, 0);
    // The instants of the fastest loop when no other is due, as they lie between instructions.
    let next = timer::now() / PERIODS[0] + 2;
    let releases = (next..).filter(|release| !is_shared(*release));
    for release in releases.take(ALARMS as usize) {
        let instant = release * PERIODS[0];
        timer::arm(instant);
        until(trace, trace.runs() + 1);
        let late = trace.began().wrapping_sub(instant);
        sum += late;
        least = least.min(late);
        most = most.max(late);
    }
    line("alarm_count", ALARMS);
    line("alarm_ticks_sum", sum);
    line("alarm_ticks_least", least);
    line("alarm_ticks_most", most);
}
