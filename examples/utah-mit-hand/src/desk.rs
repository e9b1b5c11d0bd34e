//! [`Desk`]: where a processor answers requests that are longer than a word.

use core::fmt;
use core::marker::PhantomData;

use condor_mbox::exchange::answer;
use condor_mbox::{
    AccessError, Call, Exchange, MemoryWindow, Messenger, Places, Processor, Region,
};
use condor_rt::PROCESSORS;
use zerocopy::{FromBytes, Immutable, IntoBytes};

const LINE: usize = 64;

/// Blocks in the window of the processor that answers: one for each processor that may ask, with room
/// for a request `Q`, and on the next cache line the response `R`.
///
/// The message about a request has the offset of its block as its data; the reply is 1 once the
/// response is there, and 0 for an offset that is not that of the sender's block.
pub struct Desk<Q, R> {
    blocks: u32,
    of: PhantomData<fn(Q) -> R>,
}

impl<Q, R> Desk<Q, R> {
    const BLOCK: usize =
        size_of::<Q>().next_multiple_of(LINE) + size_of::<R>().next_multiple_of(LINE);

    /// Bytes of all blocks.
    pub const BYTES: u32 = (PROCESSORS * Self::BLOCK) as u32;

    /// The next of `places`.
    ///
    /// # Errors
    /// `OutOfBounds` if there is no room.
    pub const fn new(places: &mut Places) -> Result<Self, AccessError> {
        match places.bytes(Self::BYTES as usize) {
            Ok(offset) => Ok(Self::at(offset)),
            Err(error) => Err(error),
        }
    }

    /// The desk at an offset in the users' region of its processor's `data`, in bytes.
    #[must_use]
    pub const fn at(offset: u32) -> Self {
        Self {
            blocks: offset,
            of: PhantomData,
        }
    }

    /// Where it begins, in bytes.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.blocks
    }

    /// Where the block of a processor begins, in bytes.
    #[must_use]
    pub fn block(&self, sender: Processor) -> Option<u32> {
        let block = usize::from(sender.0);
        let within = (block < PROCESSORS).then_some((block * Self::BLOCK) as u32)?;
        self.blocks.checked_add(within)
    }
}

impl<Q, R> Desk<Q, R>
where
    Q: FromBytes + IntoBytes + Immutable,
    R: FromBytes + IntoBytes + Immutable,
{
    /// Does all the work of the handler of the desk's vector; `own` is the users' region of the
    /// handler's processor.
    pub fn answer<W: MemoryWindow>(
        &self,
        call: &Call<'_>,
        own: &Region<W>,
        respond: impl FnOnce(Q) -> R,
    ) -> u32 {
        if self.block(call.sender()) == Some(call.data()) {
            answer(call, own, respond)
        } else {
            0
        }
    }

    /// Returns the end of a processor that asks; `region` is the users' region of the processor
    /// that answers. Each asking processor may have only one such end at a time.
    ///
    /// # Errors
    /// `OutOfBounds` if the desk is not in the region.
    pub fn client<'m, M: Messenger + ?Sized, W: MemoryWindow + Clone>(
        &self,
        messenger: &'m M,
        region: &Region<W>,
    ) -> Result<Exchange<'m, M, Region<W>, Q, R>, AccessError> {
        let block = self.block(messenger.number()).unwrap_or(u32::MAX);
        let mut left = Places::new(region.size());
        left.bytes(block as usize)?;
        Exchange::new(messenger, Region::whole(region.clone()), &mut left)
    }
}

impl<Q, R> Clone for Desk<Q, R> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<Q, R> Copy for Desk<Q, R> {}

impl<Q, R> fmt::Debug for Desk<Q, R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Desk").field(&self.blocks).finish()
    }
}
