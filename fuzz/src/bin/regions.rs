//! Regions, published values and locks withstand any words in their memory.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(|bytes| condor_fuzz::report("regions", condor_mbox::hostile::regions(bytes)));
