//! Accesses that survive a fault of their own.
//!
//! Each is the first instruction of a function that is nothing else. Whoever handles faults, a
//! trap handler or a signal handler, compares the address of the faulting instruction with those of
//! the functions, and goes on at the end of one: it returns to the same caller, and says that there
//! was a fault. There is no state, so accesses of interrupts and of other threads do not matter.
#![cfg(any(
    target_arch = "x86_64",
    target_arch = "aarch64",
    target_arch = "riscv32",
    target_arch = "riscv64"
))]

use core::arch::naked_asm;
use core::ffi::c_void;

use crate::bus::Width;

/// The result of an access; two registers in the conventions of all processors here.
#[repr(C)]
struct Answer {
    value: usize,
    faulted: usize,
}

macro_rules! accesses {
    ($($name:ident($($argument:ident: $kind:ty),*): $access:literal;)* => $well:literal, $ill:literal) => {
        $(
            #[unsafe(naked)]
            unsafe extern "C" fn $name($($argument: $kind),*) -> Answer {
                naked_asm!($access, $well, "ret")
            }
        )*

        #[unsafe(naked)]
        unsafe extern "C" fn faulted() -> Answer {
            naked_asm!($ill, "ret")
        }

        /// Where to go on after a fault at `instruction`; `None` if it was not an access of this module.
        pub(crate) fn resume(instruction: usize) -> Option<usize> {
            $(
                let access: unsafe extern "C" fn($($kind),*) -> Answer = $name;
                if instruction == access as usize {
                    return Some(faulted as *const () as usize);
                }
            )*
            None
        }
    };
}

#[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
accesses! {
    load8(register: *const u8): "lbu a0, 0(a0)";
    load16(register: *const u16): "lhu a0, 0(a0)";
    load32(register: *const u32): "lw a0, 0(a0)";
    store8(register: *mut u8, value: u8): "sb a1, 0(a0)";
    store16(register: *mut u16, value: u16): "sh a1, 0(a0)";
    store32(register: *mut u32, value: u32): "sw a1, 0(a0)";
    => "li a1, 0", "li a1, 1"
}

#[cfg(target_arch = "x86_64")]
accesses! {
    load8(register: *const u8): "movzx eax, byte ptr [rdi]";
    load16(register: *const u16): "movzx eax, word ptr [rdi]";
    load32(register: *const u32): "mov eax, dword ptr [rdi]";
    store8(register: *mut u8, value: u8): "mov byte ptr [rdi], sil";
    store16(register: *mut u16, value: u16): "mov word ptr [rdi], si";
    store32(register: *mut u32, value: u32): "mov dword ptr [rdi], esi";
    => "xor edx, edx", "mov edx, 1"
}

#[cfg(target_arch = "aarch64")]
accesses! {
    load8(register: *const u8): "ldrb w0, [x0]";
    load16(register: *const u16): "ldrh w0, [x0]";
    load32(register: *const u32): "ldr w0, [x0]";
    store8(register: *mut u8, value: u8): "strb w1, [x0]";
    store16(register: *mut u16, value: u16): "strh w1, [x0]";
    store32(register: *mut u32, value: u32): "str w1, [x0]";
    => "mov x1, #0", "mov x1, #1"
}

impl Answer {
    #[inline(always)]
    fn unless_faulted(self) -> Option<u32> {
        (self.faulted == 0).then_some(self.value as u32)
    }
}

/// Reads a register; `None` if that faulted.
///
/// # Safety
/// The register is aligned; it may be read, or the fault's handler asks [`resume`].
#[inline(always)]
pub(crate) unsafe fn load(register: *const c_void, width: Width) -> Option<u32> {
    // SAFETY: as for this function.
    let answer = unsafe {
        match width {
            Width::Bits8 => load8(register.cast()),
            Width::Bits16 => load16(register.cast()),
            Width::Bits32 => load32(register.cast()),
        }
    };
    answer.unless_faulted()
}

/// Writes a register; `None` if that faulted.
///
/// # Safety
/// The register is aligned; it may be written, or the fault's handler asks [`resume`].
#[inline(always)]
pub(crate) unsafe fn store(register: *mut c_void, width: Width, value: u32) -> Option<()> {
    // SAFETY: as for this function.
    let answer = unsafe {
        match width {
            Width::Bits8 => store8(register.cast(), value as u8),
            Width::Bits16 => store16(register.cast(), value as u16),
            Width::Bits32 => store32(register.cast(), value),
        }
    };
    answer.unless_faulted().map(drop)
}
