# One hart comes up here, with `{mstatus}` set; others are parked. Shared by the firmwares of one hart.

.section .init, "ax"
.global _start
_start:
    .option push
    .option norelax
    la gp, __global_pointer$
    .option pop
    csrw mie, zero
    csrci mstatus, 8
    li t0, {mstatus}
    csrs mstatus, t0
    la t0, trap_entry
    csrw mtvec, t0
    csrr a0, mhartid
    bnez a0, park
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

# What a call may change of the integer registers, and no more: as the frame of riscv-rt.
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
