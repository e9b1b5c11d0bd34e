//! Texts and images of hands, some of them good ones with faults, give hands that can be, or errors.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_hand::hostile::configuration);
