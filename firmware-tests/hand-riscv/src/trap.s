# Every trap ends the program.

.section .text.trap_entry, "ax"
.balign 4
trap_entry:
    call trap
