# Every hart comes up at the first instruction, and comes back to the second, with the reason in `a0`.
# QEMU has zeroed all that is not in the image.

.section .init, "ax"
.global _start
_start:
    .option push
    .option norvc
    j cold
    j again
    .option pop
cold:
    li a0, 0
again:
    csrw mie, zero
    csrci mstatus, 8
    .option push
    .option norelax
    la gp, __global_pointer$
    .option pop
    csrr a1, mhartid
    li t0, {harts}
    bgeu a1, t0, park
    la sp, __stacks
    addi t0, a1, 1
    slli t0, t0, 16
    add sp, sp, t0
    li t0, {control}
    slli t1, a1, 12
    add t0, t0, t1
    csrw mscratch, t0
    # Floating point is on: `fs` is initial.
    li t0, 0x6000
    csrc mstatus, t0
    li t0, 0x2000
    csrs mstatus, t0
    # The lowest bit: interrupts have places of their own.
    la t0, condor_trap_entry
    addi t0, t0, 1
    csrw mtvec, t0
    call condor_monitor
park:
    wfi
    j park
