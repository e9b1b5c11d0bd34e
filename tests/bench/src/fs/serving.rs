//! The server's process, and the mailboxes of both.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use condor_fs::server::{FileServer, ServerOptions};
use condor_fs::wire;
use condor_mbox::linux::{LinuxMailbox, LinuxSystem, LinuxWindow};
use condor_mbox::{Call, Messenger, Processor, SingleContext, Vector, Waiting, Windows};

use crate::Result;
use crate::mbox::{Mapping, spinning};
use crate::process::Orders;

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

/// Deadline of everything.
pub(super) const TIMEOUT: Duration = Duration::from_secs(10);

/// The name of the file, in its directory.
pub(super) const NAME: &str = "file";

/// A mailbox.
pub(super) type Mail<'v> = LinuxMailbox<'v, N, SingleContext>;

/// The memory that both processes have from the beginning.
pub(super) struct Shared {
    pub(super) system: LinuxSystem<N>,
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
    /// Raw exchanges, as many as the order says.
    Raw,
    /// No end any more: the server ends.
    Quit,
}

impl Turn {
    /// Asks the server for this turn, of so many exchanges, which raw ones have to know; the server is there
    /// when this returns.
    pub(super) fn begin(self, orders: &Orders, exchanges: u32) -> Result<()> {
        orders.send([self as u32, exchanges, 0])?;
        orders.hear()
    }
}

/// Ends the turn of a mailbox.
pub(super) fn end(mailbox: &Mail<'_>) -> Result<()> {
    Ok(mailbox.send_with_reply(SERVER, END, 0, TIMEOUT).map(drop)?)
}

/// Runs the server's process: serves the ends that it is asked for, until the last order.
pub(super) fn serve(shared: &Shared, directory: &Path, orders: &Orders) -> Result<()> {
    let server = FileServer::new(directory, ServerOptions::default())?;
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
    let mut mailbox = claim.mailbox_with(SingleContext::new())?;
    mailbox.set_waiting(Waiting::Spin);
    mailbox.set_vector(wire::FILES, &files, "files")?;
    mailbox.set_vector(ECHO, &echo, "echo")?;
    mailbox.set_vector(END, &end, "end")?;
    mailbox.join()?;

    let (_, mut answer) = spinning(shared.words());
    loop {
        let [turn, exchanges, _] = orders.take()?;
        orders.say()?;
        match turn {
            it if it == Turn::Mailbox as u32 => {
                while !ended.swap(false, Ordering::Relaxed) {
                    mailbox.serve(TIMEOUT)?;
                }
            }
            it if it == Turn::Raw as u32 => answer(exchanges)?,
            _ => return Ok(()),
        }
    }
}
