//! A file server withstands any client, which goes on writing while it works.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_fs::hostile::client);
