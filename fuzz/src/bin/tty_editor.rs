//! A line editor withstands any bytes, and any words that it is offered, and shows the line that it has.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_tty::hostile::editor);
