//! File operations, kills of the server at every step, confinement, and hostile peers.

mod appends;
mod crash_points;
mod deadly;
mod doubt;
mod escapes;
mod hostile_peers;
mod journal;
mod operations;
mod pointers;
mod program;
mod quota;
mod settle;
mod slow_clients;
mod support;
mod tickets;
mod trust;
mod unix;
mod unprivileged;

#[cfg(all(feature = "hostile", target_os = "linux"))]
use condor_fs::hostile::peer;
