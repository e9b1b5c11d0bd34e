//! Texts and images of hands, some of them valid ones with faults, are read as hands that keep the rules, or
//! refused with errors.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_hand::hostile::configuration);
