//! The check of accesses accepts no offset and length that reach outside of a window, and refuses no others.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_mbox::hostile::window_bounds);
