//! Hostile clients of the live server, made of bytes.

use crate::live::hostile;

/// Checks that a session keeps its promises to a client, whatever the client asks and however slowly it reads.
///
/// # Panics
/// Panics if a sample is neither sent in its order nor counted as lost, or if a queue grows without bound.
pub fn session(bytes: &[u8]) {
    hostile::session(bytes);
}

/// Checks that the server withstands any bytes of a client, before and after the handshake.
///
/// # Panics
/// Panics if the server goes on with a client that does not finish its handshake.
pub fn connection(bytes: &[u8]) {
    hostile::connection(bytes);
}
