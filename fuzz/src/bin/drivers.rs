//! Drivers withstand boards whose registers return anything, a bus that fails anywhere, and any interrupts.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(utah_mit_boards::hostile::drivers);
