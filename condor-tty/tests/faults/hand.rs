//! The processor: writes the bytes that belong to each position, until it is told to stop.

use std::time::Duration;

use condor_mbox::linux::LinuxSystem;
use condor_mbox::{Call, CriticalSection, Messenger, Region};
use condor_tty::{Policy, Terminal, TerminalSettings, TerminalVectors};
use embedded_io::Write;

use super::board::{self, Board};
use super::{AnyError, CAPACITY, HAND, N, Random, byte_at};

/// Longer than all hosts together take to start.
const TIMEOUT: Duration = Duration::from_secs(60);
const LOOK: Duration = Duration::from_millis(1);
/// Between two writes that do not wait.
const REST: Duration = Duration::from_micros(20);

pub(crate) fn play(policy: &str, mut random: Random) -> Result<(), AnyError> {
    let mut claim = LinuxSystem::<N>::inherited()?.claim(HAND)?;
    let ram = Region::users(claim.windows()[HAND.index()].data.clone())?;
    let mut allocator = claim.places()?;
    let terminal =
        Terminal::<_, _, 16>::new(ram.clone(), &mut allocator, CAPACITY, CriticalSection)?;
    if allocator.bytes(board::BYTES as usize)? != board::AT {
        return Err("the board is not where it is looked for".into());
    }
    let board = Board(ram);
    terminal.configure(&TerminalSettings::RAW)?;
    let policy = match policy {
        "block" => Policy::Block { timeout: TIMEOUT },
        "drop new" => Policy::DropNew,
        "drop old" => Policy::DropOld,
        policy => return Err(format!("there is no policy `{policy}`").into()),
    };
    terminal.set_policy(policy)?;
    let receive = |call: &Call<'_>| terminal.receive(call);
    let mut mailbox = claim.mailbox()?;
    mailbox.set_vector(TerminalVectors::DEFAULT.input, &receive, "terminal input")?;
    mailbox.set_vector(TerminalVectors::DEFAULT.room, &receive, "terminal room")?;
    mailbox.join()?;

    // Nobody waits for a host before the first one.
    while terminal.attached()?.is_none() {
        mailbox.serve(LOOK)?;
    }
    let mut console = terminal.console(&mailbox);
    let poster = terminal.poster(&mailbox);
    let mut position = 0_u32;
    let mut written = 0_u64;
    let mut bytes = [0; 600];
    while !board.is_stopped()? {
        let len = 1 + random.below(bytes.len() as u64) as usize;
        for (byte, at) in bytes.iter_mut().zip(0..len as u32) {
            *byte = byte_at(position.wrapping_add(at));
        }
        let accepted = if matches!(policy, Policy::Block { .. }) {
            console.write_all(&bytes[..len])?;
            len
        } else {
            let accepted = poster.post(&bytes[..len])?;
            mailbox.serve(REST)?;
            accepted
        };
        // What found no room has no position.
        position = position.wrapping_add(accepted as u32);
        written += len as u64;
    }
    Ok(board.done(written)?)
}
