//! Messages, regions, published values and locks, in simulated memory and on Linux.
#![cfg(not(condor_loom))]

mod backends_conform;
mod conformance;
mod exchange;
mod hostile;
mod hostile_file;
mod hostile_moves;
mod incoherent;
mod interrupt_driven;
mod interrupts;
mod linux_pollable;
mod linux_transfer;
mod linux_window;
mod memory;
mod messages;
mod model;
mod published;
mod region;
mod rejoin;
mod shared_log;
mod spin_lock;
mod static_memory;
mod writer_stopped;
