//! Hostile clients of the live server, made of bytes.

use crate::live::hostile;

/// Runs a session of the live server with a client that is made of `bytes`, for a fuzz target. Whatever the client asks
/// and however slowly it reads, each sample must be sent in its order or be counted as lost, and queues must be
/// bounded.
///
/// # Panics
/// Panics if a sample is neither sent in its order nor counted as lost, or if a queue grows without bound.
pub fn session(bytes: &[u8]) {
    hostile::session(bytes);
}

/// Runs the live server with a client that sends `bytes`, before and after the handshake, for a fuzz target.
///
/// # Panics
/// Panics if the server goes on with a client that does not finish its handshake. The server itself must not panic.
pub fn connection(bytes: &[u8]) {
    hostile::connection(bytes);
}
