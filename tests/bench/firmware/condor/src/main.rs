//! The three loops of condor-mos, with one vector for each, and counts of each.
#![no_std]
#![no_main]

mod loops;
mod platform;

pub(crate) use condor_mos::Counts as Kept;
