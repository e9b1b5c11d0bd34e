//! File operations, kills of the server at every step, confinement, and hostile peers.

mod buffered;
mod crash_points;
mod dev;
mod doubt;
mod escapes;
mod hostile;
mod hostile_peers;
mod operations;
mod peer;
mod pointers;
mod program;
mod support;
