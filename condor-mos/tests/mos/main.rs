//! Schedules, loops, locks and cells, in virtual time and on Linux.
#![cfg(not(condor_loom))]

mod alarm;
mod analysis;

mod drift;
mod instants;
mod latest;
mod linux_signals;
mod linux_threads;
mod lock;
mod loops;
mod overload;
mod rates;
mod reference;
mod scope;
mod start_at;
mod statistics;
mod tables;
mod time_in_sections;
mod timers_conform;
