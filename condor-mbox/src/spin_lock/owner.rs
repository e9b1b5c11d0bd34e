//! [`LockOwner`]: a processor in one of its incarnations, as one word of shared memory.

use core::fmt;
use core::num::NonZeroU32;

use crate::error::MailboxError;
use crate::id::Processor;

/// The owner of a [`SpinLock`](super::SpinLock): a processor in one of its incarnations.
///
/// In shared memory an owner is one word: the processor's number plus one in the upper 6 bits, and
/// the lower 26 bits of its incarnation below; zero means no owner. Incarnations that are a
/// multiple of 2²⁶ joins apart cannot be distinguished.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LockOwner(NonZeroU32);

const INCARNATION_BITS: u32 = 26;
const INCARNATION_MASK: u32 = (1 << INCARNATION_BITS) - 1;

impl LockOwner {
    /// Makes the owner that is `processor` in `incarnation`.
    /// [`Mailbox::owner`](crate::Mailbox::owner) returns the owner for a program's own processor.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if the number of `processor` is not below
    /// [`Processor::MAX_COUNT`].
    pub const fn new(processor: Processor, incarnation: u32) -> Result<Self, MailboxError> {
        let number = processor.0 as u32;
        if number < Processor::MAX_COUNT as u32
            && let Some(word) = NonZeroU32::new(
                ((number + 1) << INCARNATION_BITS) | (incarnation & INCARNATION_MASK),
            )
        {
            Ok(Self(word))
        } else {
            Err(MailboxError::NoSuchProcessor {
                number: processor,
                processors: Processor::MAX_COUNT as u8,
            })
        }
    }

    /// Returns the processor; `None` if the owner was read from shared memory and is garbage.
    #[must_use]
    pub const fn processor(self) -> Option<Processor> {
        match (self.0.get() >> INCARNATION_BITS).checked_sub(1) {
            Some(number) if number < Processor::MAX_COUNT as u32 => Some(Processor(number as u8)),
            _ => None,
        }
    }

    /// Returns true if this owner is its processor in `incarnation`. Only the lower 26 bits of the
    /// incarnation are compared.
    #[must_use]
    pub const fn is_incarnation(self, incarnation: u32) -> bool {
        self.0.get() & INCARNATION_MASK == incarnation & INCARNATION_MASK
    }

    /// Returns true if it may own something now; garbage may not.
    pub(super) fn is_alive(self, incarnations: &dyn Incarnations) -> bool {
        self.processor().is_some() && incarnations.is_current(self)
    }

    /// Returns the owner that a word of shared memory names.
    pub(super) const fn from_word(word: u32) -> Option<Self> {
        match NonZeroU32::new(word) {
            Some(word) => Some(Self(word)),
            None => None,
        }
    }

    /// The word that says so; zero for nobody.
    pub(super) const fn to_word(owner: Option<Self>) -> u32 {
        match owner {
            Some(Self(word)) => word.get(),
            None => 0,
        }
    }
}

impl fmt::Display for LockOwner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.processor() {
            Some(processor) => write!(
                f,
                "{processor} in incarnation {}",
                self.0.get() & INCARNATION_MASK
            ),
            None => write!(f, "an unknown owner ({:#010x})", self.0),
        }
    }
}

/// Tells which incarnations of processors have ended. A [`Mailbox`](crate::Mailbox) does.
///
/// # For implementers
///
/// Return `false` only with positive evidence that this incarnation is over, and then for ever: the
/// answer takes a lock away from its owner. An incarnation that is newer than any seen so far is
/// current, so read the processor's own word for its present incarnation each time, not a copy.
pub trait Incarnations {
    /// Returns true if `owner`'s incarnation may still go on; `false` only if it is known to have
    /// ended.
    fn is_current(&self, owner: LockOwner) -> bool;
}
