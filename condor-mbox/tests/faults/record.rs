//! What a survivor saw, in shared memory, so that the director can add it up.

use condor_mbox::MailboxError;

use super::board::{Board, Survivor};

/// Good replies, messages without reply, and errors by kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Count {
    Replies,
    Messages,
    Audits,
    Died,
    Restarted,
    Left,
    Stalled,
    TimedOut,
    NotConnected,
    NoSlot,
    /// Dead by `peer_state`.
    SeenDead,
    /// Tickets whose reply did not come in time.
    Unanswered,
    /// Nested calls of the victim that failed.
    FailedInside,
    Other,
    /// Longest that a wait lasted beyond its deadline, in microseconds.
    Overdue,
}

impl Count {
    pub(crate) const ALL: [(Self, &'static str); 15] = [
        (Self::Replies, "replies, all checked"),
        (Self::Messages, "messages without reply"),
        (Self::Audits, "counts compared"),
        (Self::Died, "PeerDied"),
        (Self::Restarted, "PeerRestarted"),
        (Self::Left, "PeerLeft"),
        (Self::Stalled, "Stalled"),
        (Self::TimedOut, "TimedOut"),
        (Self::NotConnected, "NotConnected"),
        (Self::NoSlot, "NoSlot"),
        (Self::SeenDead, "tickets whose peer was Dead"),
        (Self::Unanswered, "tickets given up"),
        (Self::FailedInside, "nested calls that failed"),
        (Self::Other, "other errors"),
        (Self::Overdue, "longest beyond a deadline, µs"),
    ];

    pub(crate) fn of(error: MailboxError) -> Self {
        match error {
            MailboxError::PeerDied { .. } => Self::Died,
            MailboxError::PeerRestarted { .. } => Self::Restarted,
            MailboxError::PeerLeft { .. } => Self::Left,
            MailboxError::Stalled { .. } => Self::Stalled,
            MailboxError::TimedOut { .. } => Self::TimedOut,
            MailboxError::NotConnected { .. } => Self::NotConnected,
            MailboxError::NoSlot { .. } => Self::NoSlot,
            _ => Self::Other,
        }
    }
}

/// Series of times in nanoseconds.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Series {
    /// From just before `kill` until a call that was waiting then returned.
    Waiting,
    /// From the beginning of the first call after the death until it returned.
    Later,
    /// From the spawn of the next victim until its first good reply.
    Rejoin,
}

impl Series {
    pub(crate) const ALL: [(Self, &'static str); 3] = [
        (Self::Waiting, "kill to error, waiting survivor"),
        (Self::Later, "call to error, call after the kill"),
        (Self::Rejoin, "spawn to first good reply"),
    ];
}

/// Samples that one series of one survivor can hold.
const SAMPLES: usize = 16_000;

/// The record of one survivor, which alone writes it.
pub(crate) struct Record<'b> {
    board: &'b Board,
    survivor: usize,
}

impl<'b> Record<'b> {
    pub(crate) fn new(board: &'b Board, survivor: usize) -> Self {
        Self { board, survivor }
    }

    pub(crate) fn count(&self, what: Count) -> u32 {
        self.board.record(self.survivor, what as usize)
    }

    pub(crate) fn add(&self, what: Count, step: u32) {
        let sum = self.count(what).wrapping_add(step);
        self.board.set_record(self.survivor, what as usize, sum);
    }

    pub(crate) fn raise(&self, what: Count, value: u32) {
        if value > self.count(what) {
            self.board.set_record(self.survivor, what as usize, value);
        }
    }

    pub(crate) fn sample(&self, series: Series, ns: u64) {
        let length = self.board.record(self.survivor, Self::begin(series)) as usize;
        if length < SAMPLES {
            let at = Self::begin(series) + 1 + length;
            let ns = u32::try_from(ns).unwrap_or(u32::MAX);
            self.board.set_record(self.survivor, at, ns);
            self.board
                .set_record(self.survivor, Self::begin(series), length as u32 + 1);
        }
    }

    pub(crate) fn samples(&self, series: Series) -> impl Iterator<Item = u32> {
        let begin = Self::begin(series);
        let length = self.board.record(self.survivor, begin) as usize;
        (1..=length.min(SAMPLES)).map(move |index| self.board.record(self.survivor, begin + index))
    }

    pub(crate) fn faults(&self) -> u32 {
        self.board.survivor(self.survivor, Survivor::Faults)
    }

    /// Reports something that must not happen.
    pub(crate) fn fault(&self, what: &str) {
        eprintln!("WRONG: survivor {}: {what}", self.survivor);
        self.board
            .set_survivor(self.survivor, Survivor::Faults, self.faults() + 1);
    }

    fn begin(series: Series) -> usize {
        Count::ALL.len() + series as usize * (SAMPLES + 1)
    }
}
