//! Which error may come when.

use condor_mbox::{Instant, MailboxError};

use super::board::{Board, Director, Victim};

/// What is known of the victim at one moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    pub(crate) at: Instant,
    pub(crate) claimed: u32,
    pub(crate) continued: u32,
    done: u32,
    left: u32,
    pub(crate) kills: u32,
    pub(crate) stopped: u32,
    pub(crate) ready: u32,
    pub(crate) incarnation: u32,
    pub(crate) last_incarnation: u32,
    begun: u32,
    leaving: u32,
    stopping: u32,
}

impl Moment {
    /// Before a call, the ends of things are read first, and after it their beginnings; so what
    /// happens meanwhile is taken to overlap the call.
    pub(crate) fn before(board: &Board, at: Instant) -> Self {
        let (claimed, continued) = (
            board.victim(Victim::Claimed),
            board.director(Director::Continued),
        );
        let (done, left) = (board.victim(Victim::Done), board.victim(Victim::Left));
        Self {
            claimed,
            continued,
            done,
            left,
            ..Self::after(board, at)
        }
    }

    pub(crate) fn after(board: &Board, at: Instant) -> Self {
        Self {
            at,
            claimed: board.victim(Victim::Claimed),
            continued: board.director(Director::Continued),
            done: board.victim(Victim::Done),
            left: board.victim(Victim::Left),
            kills: board.director(Director::Kills),
            stopped: board.director(Director::Stopped),
            ready: board.victim(Victim::Ready),
            incarnation: board.victim(Victim::Incarnation),
            last_incarnation: board.last_incarnation(),
            begun: board.victim(Victim::Begun),
            leaving: board.victim(Victim::Leaving),
            stopping: board.director(Director::Stopping),
        }
    }

    /// Whether the victim is stopped for certain.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stopped > self.continued
    }
}

/// A call, or a wait for a ticket, from its beginning to its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Span {
    pub(crate) before: Moment,
    pub(crate) after: Moment,
    /// Whether it waits, or ends at once.
    pub(crate) waits: bool,
    /// Whether the victim has answered this survivor in the incarnation that it had before.
    pub(crate) acquainted: bool,
}

impl Span {
    /// Whether the victim was dead at some time.
    pub(crate) fn sees_death(&self) -> bool {
        self.after.kills >= self.before.claimed.max(1)
    }

    /// Whether an incarnation was being begun or ended at some time.
    fn sees_beginning(&self) -> bool {
        self.after.begun > self.before.done
    }

    /// Whether the victim was stopped at some time.
    pub(crate) fn sees_stop(&self) -> bool {
        self.after.stopping > self.before.continued
    }

    /// Whether `error` says what was the case.
    pub(crate) fn justifies(&self, error: MailboxError) -> bool {
        match error {
            MailboxError::PeerDied { .. } => self.sees_death(),
            MailboxError::PeerRestarted { .. } => self.sees_beginning(),
            MailboxError::PeerLeft { .. } => self.after.leaving > self.before.left,
            MailboxError::Stalled { .. } | MailboxError::TimedOut { .. } => self.sees_stop(),
            MailboxError::NotConnected { .. } if self.waits => {
                self.sees_stop() && (self.sees_beginning() || !self.acquainted)
            }
            MailboxError::NotConnected { .. } => {
                self.sees_death() || self.sees_beginning() || !self.acquainted
            }
            MailboxError::NoSlot { .. } => !self.waits || self.sees_stop(),
            _ => false,
        }
    }
}
