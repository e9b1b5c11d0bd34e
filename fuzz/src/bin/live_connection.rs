//! The live server withstands any bytes of a client, before and after the handshake.
#![cfg_attr(fuzzing, no_main)]

condor_fuzz::target!(condor_cli::hostile::connection);
