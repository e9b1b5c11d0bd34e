//! Hostile clients of a gateway, made of bytes.

use crate::wire::{ClientRequest, MOTION_BYTES, by, check_name};

/// Reads a query as a gateway does, for a fuzz target. `bytes` are its key, its payload and its attachment, with a zero
/// byte between them. A query that is accepted must keep the limits of requests, and must be the same after it is
/// written and read again.
///
/// # Panics
/// Panics if an accepted query does not do so.
pub fn request(bytes: &[u8]) {
    let mut parts = bytes.splitn(3, |byte| *byte == 0);
    let mut part = || parts.next().unwrap_or_default();
    let (key, payload, attachment) = (String::from_utf8_lossy(part()), part(), part());
    let Ok(asked) = ClientRequest::read("hand", &key, payload, attachment) else {
        return;
    };
    check_name("client", &asked.client).unwrap();
    assert!(asked.motion.len() <= MOTION_BYTES);
    let key = by("hand", &asked.client, asked.request.right().word());
    let again = ClientRequest::read("hand", &key, &asked.request.payload(), &asked.motion);
    assert_eq!(again, Ok(asked));
}
