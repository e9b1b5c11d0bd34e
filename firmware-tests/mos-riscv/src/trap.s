# Where traps come. What else has to survive them is up to who handles them.

.section .text.trap_entry, "ax"
.balign 4
trap_entry:
    addi sp, sp, -128
    each sd
    csrr a0, mcause
    call trap
    each ld
    addi sp, sp, 128
    mret
