# One hart comes up here; more are parked. No floating point: it is off, and using it traps.

.section .init, "ax"
.global _start
_start:
    .option push
    .option norelax
    la gp, __global_pointer$
    .option pop
    csrw mie, zero
    csrci mstatus, 8
    la t0, trap_entry
    csrw mtvec, t0
    csrr t0, mhartid
    bnez t0, park
    la sp, __stack_end
    la t0, __bss_start
    la t1, __bss_end
clear:
    bgeu t0, t1, run
    sd zero, 0(t0)
    addi t0, t0, 8
    j clear
run:
    call main
park:
    wfi
    j park

# What a call may change.
.macro each int
    \int ra, 0(sp)
    \int t0, 8(sp)
    \int t1, 16(sp)
    \int t2, 24(sp)
    \int t3, 32(sp)
    \int t4, 40(sp)
    \int t5, 48(sp)
    \int t6, 56(sp)
    \int a0, 64(sp)
    \int a1, 72(sp)
    \int a2, 80(sp)
    \int a3, 88(sp)
    \int a4, 96(sp)
    \int a5, 104(sp)
    \int a6, 112(sp)
    \int a7, 120(sp)
.endm

.section .text.trap_entry, "ax"
.balign 4
trap_entry:
    addi sp, sp, -128
    each sd
    csrr a0, mcause
    csrr a1, mepc
    # It says where to go on.
    call trap
    csrw mepc, a0
    each ld
    addi sp, sp, 128
    mret
