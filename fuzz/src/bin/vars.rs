//! Both ends of a loop's variables withstand any words in the table, and any requests.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_vars::hostile::run);
