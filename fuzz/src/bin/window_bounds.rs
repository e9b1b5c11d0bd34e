//! No offset and length that pass the check reach outside of a window, and all others are refused.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_mbox::hostile::window_bounds);
