//! Terminals: line discipline, policies, both ends' hosts, and hostile peers.
#![cfg(not(condor_loom))]

mod cooked;
mod editor;
mod host;
mod hostile;
mod hostile_host;
mod interrupted;
mod model;
mod pty;
mod screen;
mod servo;

#[cfg(feature = "hostile")]
use condor_tty::hostile::support;
