//! Hostile clients of the live server, made of bytes.

use crate::live::hostile;

/// A session keeps its promises to a client, whatever the client asks and however slowly it reads.
///
/// # Panics
/// If a sample was neither sent in its order nor counted as lost, or if something grew without bound.
pub fn session(bytes: &[u8]) {
    hostile::session(bytes);
}

/// The server bears any bytes of a client, before and after the handshake.
///
/// # Panics
/// If it goes on with a client that does not finish its handshake.
pub fn connection(bytes: &[u8]) {
    hostile::connection(bytes);
}
