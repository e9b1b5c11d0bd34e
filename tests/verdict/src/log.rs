//! The logs of clients, and what clients and their judge must agree on.

use std::fmt;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;

use condor_mbox::Processor;

/// The name of the environment variable with the directory for the logs of a test. Its programs read it.
pub const PLACE: &str = "CONDOR_QUEUE_PLACE";
/// The names of the clients in a test. The log of each client is a file of that name.
pub const CLIENTS: [&str; 3] = ["client-a", "client-b", "client-c"];
/// The joint that each client moves, in the order of [`CLIENTS`], by its number in the hand. Each is in another finger.
pub const JOINTS: [usize; 3] = [2, 6, 10];
/// The processor of the master, whose set-points are observed.
pub const MASTER: Processor = Processor(0);

/// Returns the target of the joint, rad, in a client's request number `index`, from 0. Any two targets differ by more
/// than the error of a set-point, so a target tells which request has run.
#[must_use]
pub fn target(index: u32) -> f64 {
    // Far from one to the next, so that each moves; there is room for 30 000 within the joint's range.
    let step = 0.6 + 0.000_04 * f64::from(index / 2);
    step + if index.is_multiple_of(2) { 0.0 } else { 0.3 }
}

/// A line of a client's log: a request that it is about to send, or the outcome that it was told.
#[derive(Clone, Debug)]
pub enum Line {
    /// The request of this index is about to be sent, in a session or an incarnation, with a number.
    Offers(u32, u64, u64),
    /// The outcome that the client was told for the request of this index, as the words of the log.
    Told(u32, String),
}

/// Appends a line to the log of a client, or none of it: the client may be killed at any time.
///
/// # Errors
/// Returns the error with which the file was not written.
pub fn append(mut log: &File, line: fmt::Arguments<'_>) -> io::Result<()> {
    // One call; `writeln` would make one for each part of the line.
    log.write_all(format!("{line}\n").as_bytes())
}

/// Reads the log of a client in the file `log`, oldest line first. Lines that cannot be understood are left out, and a
/// file that cannot be read counts as empty.
#[must_use]
pub fn read(log: &Path) -> Vec<Line> {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let line = |line: &str| {
        let mut words = line.splitn(3, ' ');
        let (word, index) = (words.next()?, words.next()?.parse().ok()?);
        let rest = words.next()?;
        if word == "told" {
            return Some(Line::Told(index, rest.into()));
        }
        let (session, number) = rest.split_once(' ')?;
        Some(Line::Offers(
            index,
            session.parse().ok()?,
            number.parse().ok()?,
        ))
    };
    text.lines().filter_map(line).collect()
}
