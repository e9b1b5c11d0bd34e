# Two harts come up here; more are parked. Hart 1 waits until hart 0 rings it.

.equ STACK_BYTES, 32 * 1024
.equ MSIP_1, 0x02000004

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
    li t0, 2
    bgeu a0, t0, park
    la sp, __stacks
    li t0, STACK_BYTES
    addi t1, a0, 1
    mul t0, t0, t1
    add sp, sp, t0
    bnez a0, await_ring
    la t0, __bss_start
    la t1, __bss_end
clear:
    bgeu t0, t1, run
    sd zero, 0(t0)
    addi t0, t0, 8
    j clear
await_ring:
    csrsi mie, 8
    wfi
    csrr t0, mip
    andi t0, t0, 8
    beqz t0, await_ring
    csrci mie, 8
    li t0, MSIP_1
    sw zero, 0(t0)
    fence
run:
    call main
park:
    wfi
    j park

# What a call may change; floating point too, since handlers are free to use it.
.macro each int, float
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
    \float ft0, 128(sp)
    \float ft1, 136(sp)
    \float ft2, 144(sp)
    \float ft3, 152(sp)
    \float ft4, 160(sp)
    \float ft5, 168(sp)
    \float ft6, 176(sp)
    \float ft7, 184(sp)
    \float ft8, 192(sp)
    \float ft9, 200(sp)
    \float ft10, 208(sp)
    \float ft11, 216(sp)
    \float fa0, 224(sp)
    \float fa1, 232(sp)
    \float fa2, 240(sp)
    \float fa3, 248(sp)
    \float fa4, 256(sp)
    \float fa5, 264(sp)
    \float fa6, 272(sp)
    \float fa7, 280(sp)
.endm

.section .text.trap_entry, "ax"
.balign 4
trap_entry:
    addi sp, sp, -320
    each sd, fsd
    # A handler that lets other interrupts in would lose these.
    csrr t0, mepc
    csrr t1, mstatus
    frcsr t2
    sd t0, 288(sp)
    sd t1, 296(sp)
    sd t2, 304(sp)
    csrr a0, mcause
    call trap
    ld t0, 288(sp)
    ld t1, 296(sp)
    ld t2, 304(sp)
    csrw mepc, t0
    csrw mstatus, t1
    fscsr t2
    each ld, fld
    addi sp, sp, 320
    mret
