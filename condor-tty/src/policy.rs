//! [`Policy`]: what happens to output that finds no room.

use core::time::Duration;

/// What happens to output that finds no room.
///
/// Whatever the policy, a [`Poster`](crate::Poster) never waits, and a terminal that no host is
/// attached to makes nobody wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// The writer waits for the host, if one has attached, for at most `timeout` a write.
    ///
    /// A host that died without detaching is waited for: it may come back.
    Block {
        /// The longest wait of one write.
        timeout: Duration,
    },
    /// It is dropped and counted.
    DropNew,
    /// It overwrites the oldest output that the host has not dealt with, which the host counts.
    DropOld,
}

/// [`Policy`] as the host sees it, who is not told how long writers wait.
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
    /// What the host is told.
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
    /// The policy that `word` means in shared memory.
    #[must_use]
    pub const fn from_word(word: u32) -> Option<Self> {
        match word {
            0 => Some(Self::Block),
            1 => Some(Self::DropNew),
            2 => Some(Self::DropOld),
            _ => None,
        }
    }

    /// What it is in shared memory.
    #[must_use]
    pub const fn word(self) -> u32 {
        match self {
            Self::Block => 0,
            Self::DropNew => 1,
            Self::DropOld => 2,
        }
    }
}
