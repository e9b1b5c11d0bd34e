//! A terminal withstands a host that writes anything anywhere at any moment.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_tty::hostile::processor);
