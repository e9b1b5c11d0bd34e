//! The server's process, and the mailboxes of both.

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use condor_fs::server::{FileServer, ServerOptions};
use condor_fs::wire;
use condor_mbox::layout::BELL_BYTES;
use condor_mbox::linux::{LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{Call, Messenger, Processor, SingleContext, Vector, Waiting, Windows};
use rustix::fd::OwnedFd;

use super::socket;
use crate::Result;
use crate::mbox::{Mapping, spinning};

/// The server and the client.
pub(super) const N: usize = 2;
/// The number of the server.
pub(super) const SERVER: Processor = Processor(0);
/// The number of the client.
pub(super) const CLIENT: Processor = Processor(1);

/// Returns the data that came.
pub(super) const ECHO: Vector = Vector(1);
/// Ends the server's turn.
const END: Vector = Vector(2);

/// Reads a chunk.
pub(super) const READ: Vector = Vector(3);
/// Writes a chunk.
pub(super) const WRITE: Vector = Vector(4);

/// Deadline of everything.
pub(super) const TIMEOUT: Duration = Duration::from_secs(10);

/// The name of the file, in its directory.
pub(super) const NAME: &str = "file";

/// A mailbox.
pub(super) type Mail<'v> = LinuxMailbox<'v, N, SingleContext>;

/// The memory that both processes have from the beginning.
pub(super) struct Shared {
    pub(super) system: LinuxSystem<N>,
    /// The position of chunks in the client's region.
    pub(super) block: u32,
    /// Memory for raw exchanges.
    pub(super) lines: Mapping,
}

impl Shared {
    /// Returns the words of raw exchanges, as far apart as those of `mbox`.
    pub(super) fn words(&self) -> [&AtomicU32; 2] {
        [0, 2].map(|line| self.lines.line(line))
    }
}

/// The end that the server serves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// Messages of the mailbox.
    Mailbox = 1,
    /// Requests on the socket.
    Socket,
    /// Raw exchanges, as many as the order says.
    Raw,
    /// No end any more: the server ends.
    Quit,
}

/// A turn, and how many exchanges it has.
type Order = [u32; 2];

impl Turn {
    /// Asks the server for this turn; the server is there when this returns.
    pub(super) fn begin(self, orders: &UnixStream) -> Result<()> {
        self.begin_of(orders, 0)
    }

    /// Asks like [`begin`](Self::begin) for a turn of so many exchanges, which raw ones have to know.
    pub(super) fn begin_of(self, mut orders: &UnixStream, exchanges: u32) -> Result<()> {
        let order: Order = [self as u32, exchanges];
        orders.write_all(order.map(u32::to_ne_bytes).as_flattened())?;
        let mut ready = [0];
        Ok(orders.read_exact(&mut ready)?)
    }
}

/// Ends the turn of a mailbox.
pub(super) fn end(mailbox: &Mail<'_>) -> Result<()> {
    Ok(mailbox.send_with_reply(SERVER, END, 0, TIMEOUT).map(drop)?)
}

/// Runs the server's process: serves the ends that it is asked for, until the last order.
pub(super) fn serve(
    shared: &Shared,
    directory: &Path,
    mut orders: &UnixStream,
    requests: &UnixStream,
) -> Result<()> {
    let server = FileServer::new(directory, ServerOptions::default())?;
    let path = directory.join(NAME);
    let file: OwnedFd = File::options().read(true).write(true).open(path)?.into();
    let ended = AtomicBool::new(false);
    let end = |_: &Call<'_>| {
        // Read by this thread alone.
        ended.store(true, Ordering::Relaxed);
        0
    };
    let echo = |call: &Call<'_>| call.data();

    let claim = shared.system.claim(SERVER)?;
    let windows: [Windows<LinuxWindow>; N] = claim.windows().clone();
    let files = |call: &Call<'_>| server.answer(call, &windows);
    let block = shared.block;
    let chunks = |call: &Call<'_>| {
        let window = &windows[CLIENT.index()].data;
        answer_chunk(call, window, &file, block)
    };
    let mut mailbox = claim.mailbox_with(SingleContext::new())?;
    mailbox.set_waiting(Waiting::Spin);
    mailbox.set_vector(wire::FILES, &files, "files")?;
    mailbox.set_vector(ECHO, &echo, "echo")?;
    mailbox.set_vector(END, &end, "end")?;
    for vector in [READ, WRITE] {
        mailbox.set_vector(vector, &chunks, "chunk")?;
    }
    mailbox.join()?;

    let (_, mut answer) = spinning(shared.words());
    loop {
        let mut order = [[0; 4]; 2];
        orders.read_exact(order.as_flattened_mut())?;
        orders.write_all(&[0])?;
        let [turn, exchanges]: Order = order.map(u32::from_ne_bytes);
        match turn {
            it if it == Turn::Mailbox as u32 => {
                while !ended.swap(false, Ordering::Relaxed) {
                    mailbox.serve(TIMEOUT)?;
                }
            }
            it if it == Turn::Socket as u32 => socket::serve(requests, &file)?,
            it if it == Turn::Raw as u32 => answer(exchanges)?,
            _ => return Ok(()),
        }
    }
}

/// Reads or writes a chunk, as `chunks` has it sent, and returns its bytes.
fn answer_chunk(call: &Call<'_>, window: &LinuxWindow, file: &OwnedFd, block: u32) -> u32 {
    let (position, len) = (u64::from(call.data() >> 8), call.data() & 0xff);
    let at = BELL_BYTES + block;
    let moved = if call.vector() == READ {
        window.read_file(file, position, at, len as usize)
    } else {
        window.write_file(file, position, at, len as usize)
    };
    moved.map_or(0, |count| count as u32)
}
