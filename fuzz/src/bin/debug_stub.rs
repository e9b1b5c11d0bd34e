//! The debugger's stub withstands any words in its area, which change while it works.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_debug::hostile::stub);
