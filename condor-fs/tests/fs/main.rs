//! File operations, kills of the server at every step, confinement, and hostile peers.

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
mod settle;
mod support;
