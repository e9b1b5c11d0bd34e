# Every trap of a hart, by its cause: `condor_trap_entry` is a table of jumps, where each interrupt has its
# own place, and exceptions the first.

.section .text.condor_trap_entry, "ax"
.balign 256
.global condor_trap_entry
condor_trap_entry:
    .option push
    .option norvc
    j exception
    .rept 6
    j interrupt
    .endr
    j timer
    .rept 8
    j interrupt
    .endr
    .option pop

# An interrupt is a call on the stack that it interrupts. What a call may change of the integer registers
# is saved, and what another trap changes; floating point is up to the handlers.
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
interrupt:
    addi sp, sp, -144
    each sd
    csrr t0, mepc
    csrr t1, mstatus
    sd t0, 128(sp)
    sd t1, 136(sp)
    csrr a0, mcause
    call condor_interrupt
    ld t0, 128(sp)
    ld t1, 136(sp)
    csrw mepc, t0
    csrw mstatus, t1
    each ld
    addi sp, sp, 144
    mret

# The timer's handler saves the rest itself.
timer:
    addi sp, sp, -128
    each sd
    call condor_timer
    each ld
    addi sp, sp, 128
    mret

# An exception ends the program: nothing of it is used any more, its stack included. `mscratch` leads to a
# place of the hart for its registers, `x1` to `x31` one after the other.
exception:
    csrrw t0, mscratch, t0
    sd x6, 40(t0)
    sd x1, 0(t0)
    sd x2, 8(t0)
    sd x3, 16(t0)
    sd x4, 24(t0)
    csrr t1, mscratch
    sd t1, 32(t0)
    csrw mscratch, t0
    sd x7, 48(t0)
    sd x8, 56(t0)
    sd x9, 64(t0)
    sd x10, 72(t0)
    sd x11, 80(t0)
    sd x12, 88(t0)
    sd x13, 96(t0)
    sd x14, 104(t0)
    sd x15, 112(t0)
    sd x16, 120(t0)
    sd x17, 128(t0)
    sd x18, 136(t0)
    sd x19, 144(t0)
    sd x20, 152(t0)
    sd x21, 160(t0)
    sd x22, 168(t0)
    sd x23, 176(t0)
    sd x24, 184(t0)
    sd x25, 192(t0)
    sd x26, 200(t0)
    sd x27, 208(t0)
    sd x28, 216(t0)
    sd x29, 224(t0)
    sd x30, 232(t0)
    sd x31, 240(t0)
    li a0, {faulted}
    li t1, {monitor}
    jr t1
