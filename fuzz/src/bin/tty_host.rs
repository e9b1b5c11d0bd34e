//! The host's end of a terminal withstands a processor that writes and replies anything at any moment.
#![cfg_attr(fuzzing, no_main)]

use condor_tty::hostile::{host, reader};

condor_fuzz::target!(|bytes| match bytes.split_first() {
    Some((0..128, rest)) => reader(rest),
    Some((_, rest)) => host(rest),
    None => {}
});
