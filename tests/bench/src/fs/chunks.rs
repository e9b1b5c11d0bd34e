//! 200-byte chunks of rpmsgfs's shape: each a message with a reply, and a copy by the client.
//!
//! The server moves a chunk between the file and a block of the client's window by one call of the
//! kernel, so that the one copy is all that the shape costs beside its messages.

use condor_mbox::layout::BELL_BYTES;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Call, MemoryWindow, Messenger, Region, Vector};
use rustix::fd::OwnedFd;

use super::serving::{Mail, SERVER, TIMEOUT};
use super::ways::Operation;
use crate::Result;

/// Bytes of a chunk.
pub(super) const CHUNK: usize = 200;

const READ: Vector = Vector(3);
const WRITE: Vector = Vector(4);

/// The vectors, for the server.
pub(super) const VECTORS: [Vector; 2] = [READ, WRITE];

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

/// The server's handler.
pub(super) fn answer(call: &Call<'_>, window: &LinuxWindow, file: &OwnedFd, block: u32) -> u32 {
    let (position, len) = (u64::from(call.data() >> 8), call.data() & 0xff);
    let at = BELL_BYTES + block;
    let moved = if call.vector() == READ {
        window.read_file(file, position, at, len as usize)
    } else {
        window.write_file(file, position, at, len as usize)
    };
    moved.map_or(0, |count| count as u32)
}
