//! The free-running counter and the alarm.
//!
//! The counter is the first half of the CMSDK dual timer, the alarm the first CMSDK APB timer
//! (Arm DDI 0479, sections 4.2 and 4.3). Both run from the same 25 MHz and count down.

use core::arch::asm;

/// The number of ticks of the counter in a second.
pub const HERTZ: u32 = 25_000_000;

const ALARM: usize = 0x4000_0000;
const ALARM_CONTROL: usize = ALARM;
const ALARM_RELOAD: usize = ALARM + 0x8;

/// The address of the alarm's interrupt status; writing 1 withdraws the interrupt.
pub const ALARM_STATUS: usize = ALARM + 0xC;

/// The address of the alarm's present value: a value that is written is counted down to the interrupt.
pub const ALARM_VALUE: usize = ALARM + 0x4;

const COUNTER: usize = 0x4000_2000;
const COUNTER_LOAD: usize = COUNTER;
const COUNTER_CONTROL: usize = COUNTER + 0x8;

/// The address of the counter's present value; it counts down.
pub const COUNTER_VALUE: usize = COUNTER + 0x4;

const ALARM_ENABLE: u32 = 1;
const ALARM_INTERRUPT: u32 = 1 << 3;
const COUNTER_32_BIT: u32 = 1 << 1;
const COUNTER_ENABLE: u32 = 1 << 7;

/// Stops counter and alarm, with the counter at 0: the alarm can be armed, and does not go off.
pub fn stop_at_zero() {
    write(COUNTER_CONTROL, COUNTER_32_BIT);
    write(COUNTER_LOAD, u32::MAX);
    write(ALARM_CONTROL, 0);
    // With nothing to reload, the alarm stops when it has gone off.
    write(ALARM_RELOAD, 0);
    write(ALARM_STATUS, 1);
    // With nothing to count either, QEMU would complain.
    write(ALARM_VALUE, u32::MAX);
}

/// Starts counter and alarm.
pub fn start() {
    write(ALARM_CONTROL, ALARM_ENABLE | ALARM_INTERRUPT);
    write(COUNTER_CONTROL, COUNTER_32_BIT | COUNTER_ENABLE);
}

/// Returns the time since [`start`], in ticks; it wraps after 171 s.
#[inline(always)]
#[must_use]
pub fn now() -> u32 {
    // SAFETY: the board has this register, and a read has no effect.
    !unsafe { (COUNTER_VALUE as *const u32).read_volatile() }
}

/// Lets the alarm go off at `instant`, or at the next tick if that has passed.
///
/// The interrupt comes a little later than the instant, always by as many instructions as lie
/// between the read of the counter and the write of the alarm. Hence the assembly: compilers
/// would put more or fewer there, and what the body of a loop reads could not be told in
/// instructions since the interrupt.
#[inline(always)]
pub fn arm(instant: u32) {
    let _ = set::<1>(instant);
}

/// Sets the alarm like [`arm`], but an instant that has passed raises no interrupt; returns true if the
/// instant is ahead.
#[must_use]
#[inline(always)]
pub fn arm_ahead(instant: u32) -> bool {
    set::<0>(instant) != 0
}

/// Sets the alarm to the ticks that are left, or to `LEAST` if there are none; returns that number.
#[inline(always)]
fn set<const LEAST: u32>(instant: u32) -> u32 {
    let left: u32;
    // SAFETY: the board has these registers, and nothing else writes the alarm's.
    unsafe {
        asm!(
            "ldr {left}, [{counter}]",
            // The counter reads !now, so that instant - now = instant + counter + 1.
            "adds {left}, {left}, {instant}",
            "adds {left}, {left}, #1",
            "cmp {left}, #1",
            "it lt",
            "movlt {left}, #{least}",
            "str {left}, [{alarm}]",
            left = out(reg) left,
            least = const LEAST,
            instant = in(reg) instant,
            counter = in(reg) COUNTER_VALUE,
            alarm = in(reg) ALARM_VALUE,
            options(nostack),
        );
    }
    left
}

/// Withdraws the interrupt of the alarm.
#[inline(always)]
pub fn acknowledge() {
    write(ALARM_STATUS, 1);
}

#[inline(always)]
fn write(register: usize, value: u32) {
    // SAFETY: the board has this register, and this module alone writes it.
    unsafe { (register as *mut u32).write_volatile(value) };
}
