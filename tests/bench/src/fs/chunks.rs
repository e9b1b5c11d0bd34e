//! 200-byte chunks of rpmsgfs's shape: each a message with a reply, and a copy by the client.
//!
//! The server moves a chunk between the file and a block of the client's window by one call of the
//! kernel, so that the one copy is all that the shape costs beside its messages.

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{MemoryWindow, Messenger, Region};

use super::serving::{Mail, READ, SERVER, TIMEOUT, WRITE};
use super::ways::Operation;
use crate::Result;

/// Bytes of a chunk.
pub(super) const CHUNK: usize = 200;

/// Moves all of `data` from or to the beginning of the file, by way of the block at `block`.
pub(super) fn transfer(
    mailbox: &Mail<'_>,
    own: &Region<LinuxWindow>,
    block: u32,
    operation: Operation,
    data: &mut [u8],
) -> Result<usize> {
    let mut offset = 0;
    for chunk in data.chunks_mut(CHUNK) {
        let message = (offset << 8) | chunk.len() as u32;
        let moved = match operation {
            Operation::Read => {
                let moved = mailbox.send_with_reply(SERVER, READ, message, TIMEOUT)?;
                own.read(block, chunk)?;
                moved
            }
            Operation::Write => {
                own.write(block, chunk)?;
                mailbox.send_with_reply(SERVER, WRITE, message, TIMEOUT)?
            }
        };
        if moved as usize != chunk.len() {
            return Err("the server moved something else".into());
        }
        offset += moved;
    }
    Ok(offset as usize)
}
