# Where traps come: main.rs says where to go on.

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
