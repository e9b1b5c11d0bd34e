# Every trap of a hart, by its cause: `condor_trap_entry` is a table of jumps, where each interrupt has its
# own place, and exceptions the first.

.section .text.condor_trap_entry, "ax"
.balign 256
.global condor_trap_entry
condor_trap_entry:
    .option push
    .option norvc
    j exception
    .rept 2
    j interrupt
    .endr
    j software
    .rept 3
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
# For backtraces: the interrupted instruction, at 128, is where the frame came from.
    .macro saved bytes
    .cfi_signal_frame
    .cfi_return_column 0
    .cfi_def_cfa sp, \bytes
    .cfi_offset 0, 128 - \bytes
    .cfi_offset ra, 0 - \bytes
    .cfi_offset t0, 8 - \bytes
    .cfi_offset t1, 16 - \bytes
    .cfi_offset t2, 24 - \bytes
    .cfi_offset t3, 32 - \bytes
    .cfi_offset t4, 40 - \bytes
    .cfi_offset t5, 48 - \bytes
    .cfi_offset t6, 56 - \bytes
    .cfi_offset a0, 64 - \bytes
    .cfi_offset a1, 72 - \bytes
    .cfi_offset a2, 80 - \bytes
    .cfi_offset a3, 88 - \bytes
    .cfi_offset a4, 96 - \bytes
    .cfi_offset a5, 104 - \bytes
    .cfi_offset a6, 112 - \bytes
    .cfi_offset a7, 120 - \bytes
    .endm
    .macro enter
    .cfi_startproc
    saved 144
    addi sp, sp, -144
    each sd
    csrr t0, mepc
    csrr t1, mstatus
    sd t0, 128(sp)
    sd t1, 136(sp)
    .endm
# Other traps may have come in between.
    .macro restore
    ld t0, 128(sp)
    ld t1, 136(sp)
    csrw mepc, t0
    csrw mstatus, t1
    .endm
    .macro leave
    each ld
    addi sp, sp, 144
    mret
    .endm
interrupt:
    enter
    csrr a0, mcause
    call condor_interrupt
    restore
    leave
    .cfi_endproc

software:
    enter
    call condor_software
    restore
    bnez a0, called
    leave

# The debugger calls its stub: it is as if the interrupted instruction had made an exception, whose cause
# is still that of the interrupt.
called:
    each ld
    addi sp, sp, 144
    j exception
    .cfi_endproc

# The timer's handler saves `mepc` and `mstatus`, too; these here are for a debugger, whose breakpoints in the
# handler change them before it saves them, and after it has restored them.
timer:
    enter
    call condor_timer
    restore
    leave
    .cfi_endproc

# An exception holds the program for a debugger, or ends it; nothing of it is used here, its stack included.
# `mscratch` leads to a place of the hart for its registers: the frame of the debugger's stub. What follows the
# registers there is the trap entry's own: `mtvec`, whether a breakpoint was lifted, and t1 to t3 of the stub.
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
    csrr t1, mepc
    csrr t2, mstatus
    sd t1, 248(t0)
    sd t2, 256(t0)
    csrr t1, mcause
    csrr t2, mtval
    sd t1, 264(t0)
    sd t2, 272(t0)
    # Floating point is on for the program, unless it has destroyed its `mstatus`.
    .option push
    .option arch, +d
    li t1, 0x6000
    csrs mstatus, t1
    .altmacro
    .macro float instruction number
    \instruction f\number, 280 + 8 * \number(t0)
    .endm
    .irp number, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15
    float fsd \number
    .endr
    .irp number, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31
    float fsd \number
    .endr
    frcsr t1
    sd t1, 536(t0)
    # The stub is a part of the program, with whose breakpoints it must not stop.
    csrr t1, mtvec
    sd t1, 544(t0)
    sd zero, 552(t0)
    .option norelax
    lla t1, in_stub
    csrw mtvec, t1
    ld a0, 264(t0)
    ld a1, 248(t0)
    lla gp, __global_pointer$
    csrr t1, mhartid
    addi t1, t1, 1
    slli t1, t1, {stack_shift}
    lla sp, condor_debug_stacks
    add sp, sp, t1
    call condor_exception
end_stub:
    csrr t0, mscratch
    ld t1, 552(t0)
    beqz t1, 3f
    # Breakpoints that were lifted meanwhile, unless they were removed.
    addi t1, t0, {planted}
    li t2, {most_planted}
    li t3, 1
    li t4, {c_ebreak}
1:  lw t5, 12(t1)
    bne t5, t3, 2f
    ld t5, 0(t1)
    sh t4, 0(t5)
2:  addi t1, t1, 16
    addi t2, t2, -1
    bnez t2, 1b
    fence.i
3:  ld t1, 544(t0)
    csrw mtvec, t1
    ld t1, 256(t0)
    beqz a0, fatal
    .irp number, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15
    float fld \number
    .endr
    .irp number, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31
    float fld \number
    .endr
    ld t2, 536(t0)
    fscsr t2
    .option pop
    csrw mstatus, t1
    ld t1, 248(t0)
    csrw mepc, t1
    ld x1, 0(t0)
    ld x2, 8(t0)
    ld x3, 16(t0)
    ld x4, 24(t0)
    ld x6, 40(t0)
    ld x7, 48(t0)
    ld x8, 56(t0)
    ld x9, 64(t0)
    ld x10, 72(t0)
    ld x11, 80(t0)
    ld x12, 88(t0)
    ld x13, 96(t0)
    ld x14, 104(t0)
    ld x15, 112(t0)
    ld x16, 120(t0)
    ld x17, 128(t0)
    ld x18, 136(t0)
    ld x19, 144(t0)
    ld x20, 152(t0)
    ld x21, 160(t0)
    ld x22, 168(t0)
    ld x23, 176(t0)
    ld x24, 184(t0)
    ld x25, 192(t0)
    ld x26, 200(t0)
    ld x27, 208(t0)
    ld x28, 216(t0)
    ld x29, 224(t0)
    ld x30, 232(t0)
    ld x31, 240(t0)
    ld t0, 32(t0)
    mret

# A trap while the stub runs: of a breakpoint of the program, which is lifted until the stub is done. Anything
# else is as if no debugger wanted the program. Interrupts are masked.
    .balign 4
in_stub:
    csrrw t0, mscratch, t0
    sd t1, 560(t0)
    sd t2, 568(t0)
    sd t3, 576(t0)
    csrr t1, mcause
    li t2, {breakpoint}
    bne t1, t2, 4f
    csrr t1, mepc
    addi t2, t0, {planted}
    li t3, {most_planted}
    sd t3, 552(t0)
1:  ld t3, 0(t2)
    bne t3, t1, 2f
    lw t3, 12(t2)
    addi t3, t3, -1
    beqz t3, 3f
2:  addi t2, t2, 16
    ld t3, 552(t0)
    addi t3, t3, -1
    sd t3, 552(t0)
    bnez t3, 1b
    j 4f
3:  lhu t3, 8(t2)
    sh t3, 0(t1)
    fence.i
    ld t1, 560(t0)
    ld t2, 568(t0)
    ld t3, 576(t0)
    csrrw t0, mscratch, t0
    mret
4:  csrw mscratch, t0
    ld t1, 544(t0)
    csrw mtvec, t1
    ld t1, 256(t0)
    j fatal

# No debugger wants the program, whose monitor reads how it was.
fatal:
    csrw mstatus, t1
    li a0, {faulted}
    li t1, {monitor}
    jr t1
.global condor_trap_end
condor_trap_end:
