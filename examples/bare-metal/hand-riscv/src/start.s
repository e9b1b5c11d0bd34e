# One hart comes up here; others are parked.

.section .init, "ax"
.global _start
_start:
    .option push
    .option norelax
    la gp, __global_pointer$
    .option pop
    csrw mie, zero
    csrci mstatus, 8
    # Floating point is on: `fs` is initial.
    li t0, 0x2000
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

.balign 4
trap_entry:
    call trap
