//! The three loops of condor-mos, with one vector for each, without statistics.
#![no_std]
#![no_main]

mod loops;
mod platform;

pub(crate) use condor_mos::NoStatistics as Kept;
