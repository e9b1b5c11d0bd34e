//! A gateway withstands any query: key, payload and attachment, with a zero between them.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_remote::hostile::request);
