//! A finger's controller withstands any user and any sensors.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_hand::hostile::control);
