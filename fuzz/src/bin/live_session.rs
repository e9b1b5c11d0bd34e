//! A session of the live server keeps its promises to a client, whatever it asks and however slowly it reads.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_cli::hostile::session);
