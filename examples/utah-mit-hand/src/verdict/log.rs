//! The logs of clients, and what clients and their judge must agree on.

use std::path::Path;

use condor_mbox::Processor;

/// The variable with the directory of a run, for the programs.
pub const PLACE: &str = "CONDOR_QUEUE_PLACE";
/// The clients; each one's log has its name.
pub const CLIENTS: [&str; 3] = ["client-a", "client-b", "client-c"];
/// The joint that each client moves: the middle one of a finger of its own.
pub const JOINTS: [usize; 3] = [2, 6, 10];
/// The processor whose set-points are observed.
pub const MASTER: Processor = Processor(0);

/// Returns the target of a client's request, counted from 0, rad: all differ by more than the set-points are
/// exact.
#[must_use]
pub fn target(index: u32) -> f64 {
    // Far from one to the next, so that each moves; there is room for 30 000 within the joint's range.
    let step = 0.6 + 0.000_04 * f64::from(index / 2);
    step + if index.is_multiple_of(2) { 0.0 } else { 0.3 }
}

/// A line of the log.
#[derive(Clone, Debug)]
pub enum Line {
    /// The request of this index is about to be sent, in a session or an incarnation, with a number.
    Offers(u32, u64, u64),
    /// Its outcome, as the words of the log.
    Told(u32, String),
}

/// Reads a log.
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
