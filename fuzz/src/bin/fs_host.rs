//! A client of the file service withstands any host.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_fs::hostile::host);
