use core::fmt;
use core::marker::PhantomData;

use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{Exchange, answer, response_at};
use crate::id::Processor;
use crate::layout::LINE;
use crate::mailbox::{Call, Messenger};
use crate::region::{Allocator, Region};
use crate::window::{AccessError, MemoryWindow};

/// Memory for requests and responses in the window of the processor that answers, with one block
/// for each processor that may ask.
///
/// With these blocks, programs that ask by an [`Exchange`] need no shared memory of their own. Each
/// may have only one exchange at a time. Both sides must make the blocks at the same offset, with
/// the same number of processors.
pub struct Blocks<Q, R> {
    offset: u32,
    processors: u32,
    of: PhantomData<fn(Q) -> R>,
}

impl<Q, R> Blocks<Q, R> {
    /// The size of a block, in bytes.
    const BLOCK: u32 = response_at::<Q>(0) + (size_of::<R>() as u32).next_multiple_of(LINE);

    /// Takes the blocks from `allocator`, that of the users' region of the processor that
    /// answers. Processors 0 to `processors` − 1 may ask.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn new(allocator: &mut Allocator, processors: u8) -> Result<Self, AccessError> {
        match allocator.bytes(processors as usize * Self::BLOCK as usize) {
            Ok(offset) => Ok(Self::at(offset, processors)),
            Err(error) => Err(error),
        }
    }

    /// Returns the blocks at `offset`, in bytes from the beginning of the users' region of the
    /// processor that answers. Processors 0 to `processors` − 1 may ask.
    #[must_use]
    pub const fn at(offset: u32, processors: u8) -> Self {
        Self {
            offset,
            processors: processors as u32,
            of: PhantomData,
        }
    }

    /// Returns the offset of the first block, in bytes from the beginning of the users' region of
    /// the processor that answers.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.offset
    }

    /// Returns the size of all blocks together, in bytes.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.processors as usize * Self::BLOCK as usize
    }

    /// Returns the offset of the block for requests from `sender`, in bytes from the beginning of
    /// the users' region; `None` if `sender` has no block.
    #[must_use]
    pub fn block(&self, sender: Processor) -> Option<u32> {
        let number = u32::from(sender.0);
        if number >= self.processors {
            return None;
        }
        self.offset.checked_add(number.checked_mul(Self::BLOCK)?)
    }
}

impl<Q, R> Blocks<Q, R>
where
    Q: FromBytes + IntoBytes + Immutable,
    R: FromBytes + IntoBytes + Immutable,
{
    /// Answers a request as [`answer`](super::answer) does, if `call` names the sender's own block.
    /// Otherwise refuses the request: the sender gets
    /// [`ExchangeError::Refused`](super::ExchangeError::Refused). `own` is the users' region of the
    /// processor that answers.
    pub fn answer<W: MemoryWindow>(
        &self,
        call: &Call<'_>,
        own: &Region<W>,
        respond: impl FnOnce(Q) -> R,
    ) -> u32 {
        if self.block(call.sender()) == Some(call.data()) {
            answer(call, own, respond)
        } else {
            super::REFUSED
        }
    }

    /// Makes the exchange by which the processor of `messenger` asks. `region` is the users' region
    /// of the processor that answers.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no block for the processor of
    /// `messenger`, or if the block does not lie in `region`.
    pub fn client<'m, M: Messenger + ?Sized, W: MemoryWindow + Clone>(
        &self,
        messenger: &'m M,
        region: &Region<W>,
    ) -> Result<Exchange<'m, M, Region<W>, Q, R>, AccessError> {
        let block = self.block(messenger.number()).unwrap_or(u32::MAX);
        let mut left = Allocator::new(region.size());
        left.bytes(block as usize)?;
        Exchange::new(messenger, Region::whole(region.clone()), &mut left)
    }
}

impl<Q, R> Clone for Blocks<Q, R> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<Q, R> Copy for Blocks<Q, R> {}

impl<Q, R> PartialEq for Blocks<Q, R> {
    fn eq(&self, other: &Self) -> bool {
        (self.offset, self.processors) == (other.offset, other.processors)
    }
}

impl<Q, R> Eq for Blocks<Q, R> {}

impl<Q, R> fmt::Debug for Blocks<Q, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Blocks")
            .field("offset", &self.offset)
            .field("processors", &self.processors)
            .finish()
    }
}
