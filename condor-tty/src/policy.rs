//! [`Policy`]: what happens to output for which there is no room.

use core::time::Duration;

/// The treatment of output for which there is no room.
///
/// Under every policy, a [`Poster`](crate::Poster) never waits, and no program waits for a terminal
/// to which no host is attached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// The writer waits for the host, if one has attached, for at most `timeout` per write.
    ///
    /// It also waits for a host that died without detaching, since that may come back.
    Block {
        /// The longest wait of one write.
        timeout: Duration,
    },
    /// The new output is dropped and counted.
    DropNew,
    /// The new output overwrites the oldest output that the host has not acknowledged; the host
    /// counts it.
    DropOld,
}

/// A [`Policy`] without its time-out, as the host sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PolicyKind {
    /// [`Policy::Block`].
    Block,
    /// [`Policy::DropNew`].
    DropNew,
    /// [`Policy::DropOld`].
    DropOld,
}

impl Policy {
    /// Returns the kind, which the host can see.
    #[must_use]
    pub const fn kind(self) -> PolicyKind {
        match self {
            Self::Block { .. } => PolicyKind::Block,
            Self::DropNew => PolicyKind::DropNew,
            Self::DropOld => PolicyKind::DropOld,
        }
    }
}

impl PolicyKind {
    /// Returns the policy that `word` stands for in shared memory; `None` if it is none.
    #[must_use]
    pub const fn from_word(word: u32) -> Option<Self> {
        match word {
            0 => Some(Self::Block),
            1 => Some(Self::DropNew),
            2 => Some(Self::DropOld),
            _ => None,
        }
    }

    /// Returns the word for this policy in shared memory.
    #[must_use]
    pub const fn word(self) -> u32 {
        match self {
            Self::Block => 0,
            Self::DropNew => 1,
            Self::DropOld => 2,
        }
    }
}
