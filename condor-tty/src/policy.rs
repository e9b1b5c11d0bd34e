//! [`Policy`]: the treatment of output for which there is no room.

use core::time::Duration;

use crate::layout::policy;

/// The way in which a [`Terminal`](crate::Terminal) treats output for which its ring has no room.
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
    /// The new output overwrites the oldest output that the host has not acknowledged. The host
    /// counts the overwritten bytes.
    DropOld,
}

impl Policy {
    /// The word for this policy in shared memory.
    pub(crate) const fn word(self) -> u32 {
        match self {
            Self::Block { .. } => policy::BLOCK,
            Self::DropNew => policy::DROP_NEW,
            Self::DropOld => policy::DROP_OLD,
        }
    }
}
