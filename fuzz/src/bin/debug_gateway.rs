//! The gateway of a debugger withstands any bytes, and leaves the program running and without breakpoints.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_debug::hostile::gateway);
