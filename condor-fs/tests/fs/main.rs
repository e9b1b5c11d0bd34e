//! File operations, kills of the server at every step, confinement, and hostile peers.

mod appends;
mod buffered;
mod crash_points;
mod deadly;
mod dev;
mod doubt;
mod escapes;
mod hostile;
mod hostile_peers;
mod journal;
mod operations;
mod peer;
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
