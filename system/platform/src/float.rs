//! [`FloatExceptions`]: the floating-point exceptions that arithmetic has raised.

use core::fmt;

/// The floating-point exceptions that hide a mistake: an invalid operation, a division by zero, and an overflow
/// (IEEE 754-2019, section 7). Inexact results and underflow do not count.
///
/// Processors note exceptions and go on. Each thread, and each hart, has its own notes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FloatExceptions {
    /// An operation had no result, such as 0/0 or the square root of -1, or a number was too large for the integer type
    /// that it was converted to.
    pub invalid: bool,
    /// A number was divided by zero.
    pub division_by_zero: bool,
    /// A result was too large for its type.
    pub overflow: bool,
}

impl FloatExceptions {
    /// Returns the exceptions that the calling thread, or this hart, has raised since the last call, and clears its notes.
    /// Returns none on processors other than x86-64, `AArch64` and RISC-V, and on a hart without floating point. A hart
    /// without an operating system must be in machine mode.
    ///
    /// A compiler may move arithmetic past this call, so call it between functions that it cannot see into. It may also do
    /// arithmetic whose result is not used, and a conversion of a number that is too large for an integer type, which
    /// Rust defines, counts as invalid.
    #[must_use]
    pub fn take() -> Self {
        notes::take()
    }

    /// Returns true if there is at least one.
    #[must_use]
    pub const fn any(self) -> bool {
        self.invalid || self.division_by_zero || self.overflow
    }

    /// Reads the three exceptions from the register `notes`, where each has the bit that is given for it.
    #[allow(dead_code, reason = "not all processors have notes")]
    const fn of(notes: u32, [invalid, division_by_zero, overflow]: [u32; 3]) -> Self {
        Self {
            invalid: notes & invalid != 0,
            division_by_zero: notes & division_by_zero != 0,
            overflow: notes & overflow != 0,
        }
    }
}

impl fmt::Display for FloatExceptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = [
            (self.invalid, "an invalid operation"),
            (self.division_by_zero, "a division by zero"),
            (self.overflow, "an overflow"),
        ];
        let raised = all.into_iter().filter_map(|(is, name)| is.then_some(name));
        for (place, name) in raised.enumerate() {
            f.write_str(if place > 0 { ", " } else { "" })?;
            f.write_str(name)?;
        }
        Ok(())
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
mod notes {
    use core::arch::asm;

    use super::FloatExceptions;

    /// The bits of MXCSR.
    const BITS: [u32; 3] = [1, 1 << 2, 1 << 3];

    pub(super) fn take() -> FloatExceptions {
        let mut word = 0_u32;
        // SAFETY: it stores a word to `word`.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut word, options(nostack)) };
        let [invalid, division_by_zero, overflow] = BITS;
        let cleared = word & !(invalid | division_by_zero | overflow);
        // SAFETY: it clears notes, and changes neither masks nor rounding.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const cleared, options(nostack, readonly)) };
        FloatExceptions::of(word, BITS)
    }
}

#[cfg(all(target_arch = "aarch64", not(miri)))]
mod notes {
    use core::arch::asm;

    use super::FloatExceptions;

    /// The bits of FPSR.
    const BITS: [u32; 3] = [1, 1 << 1, 1 << 2];

    pub(super) fn take() -> FloatExceptions {
        let word: u64;
        // SAFETY: it reads notes, and clears them.
        unsafe {
            asm!("mrs {}, fpsr", out(reg) word, options(nomem, nostack));
            asm!("msr fpsr, {}", in(reg) word & !0b111, options(nomem, nostack));
        }
        FloatExceptions::of(word as u32, BITS)
    }
}

#[cfg(all(any(target_arch = "riscv32", target_arch = "riscv64"), not(miri)))]
mod notes {
    use core::arch::asm;

    use super::FloatExceptions;

    /// The bits of `fflags`.
    const BITS: [u32; 3] = [1 << 4, 1 << 3, 1 << 2];
    /// `mstatus.FS`, which is 0 if there is no unit, or if it is off. A compiler tells a crate nothing of it.
    const UNIT: usize = 3 << 13;

    pub(super) fn take() -> FloatExceptions {
        if !is_on() {
            return FloatExceptions::default();
        }
        let word: usize;
        // SAFETY: the unit is on; this reads notes, and clears those of three exceptions.
        unsafe {
            asm!("csrrc {}, 1, {}", out(reg) word, in(reg) 0b1_1100_usize, options(nomem, nostack));
        }
        FloatExceptions::of(word as u32, BITS)
    }

    /// Programs of an operating system have the unit on.
    fn is_on() -> bool {
        if cfg!(not(target_os = "none")) {
            return true;
        }
        let status: usize;
        // SAFETY: a hart in machine mode may read it.
        unsafe { asm!("csrr {}, mstatus", out(reg) status, options(nomem, nostack)) };
        status & UNIT != 0
    }
}

#[cfg(any(
    miri,
    not(any(
        target_arch = "x86_64",
        target_arch = "aarch64",
        target_arch = "riscv32",
        target_arch = "riscv64"
    ))
))]
mod notes {
    use super::FloatExceptions;

    pub(super) fn take() -> FloatExceptions {
        FloatExceptions::default()
    }
}

#[cfg(test)]
mod tests {
    use core::hint::black_box;

    use super::*;

    #[cfg(all(any(target_arch = "x86_64", target_arch = "aarch64"), not(miri)))]
    #[test]
    fn each_is_noted_and_then_forgotten() {
        let raised = |numerator: f64, divisor: f64| {
            let _ = FloatExceptions::take();
            black_box(black_box(numerator) / black_box(divisor));
            FloatExceptions::take()
        };
        let expected = |invalid, division_by_zero, overflow| FloatExceptions {
            invalid,
            division_by_zero,
            overflow,
        };
        assert_eq!(raised(0.0, 0.0), expected(true, false, false));
        assert_eq!(raised(1.0, 0.0), expected(false, true, false));
        assert_eq!(raised(1e300, 1e-300), expected(false, false, true));
        assert!(!raised(1.0, 3.0).any() && !raised(1e-300, 1e300).any());
        assert!(!FloatExceptions::take().any());
    }

    #[test]
    fn they_are_named() {
        let mut exceptions = FloatExceptions::default();
        assert_eq!(exceptions.to_string(), "");
        exceptions.overflow = true;
        assert_eq!(exceptions.to_string(), "an overflow");
        exceptions.invalid = true;
        let both = "an invalid operation, an overflow";
        assert_eq!(exceptions.to_string(), both);
    }
}
