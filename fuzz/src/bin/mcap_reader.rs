//! A reader of MCAP files reads any bytes or refuses them, and what it has read can be written and read again.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_mcap::hostile::reader);
