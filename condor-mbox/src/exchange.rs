//! [`Exchange`]: requests and responses that are longer than one word.

mod blocks;

pub use blocks::Blocks;

use core::marker::PhantomData;
use core::time::Duration;

use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::error::MailboxError;
use crate::id::{Processor, Vector};
use crate::layout::LINE;
use crate::mailbox::{Call, MessageTicket, Messenger};
use crate::region::{Allocator, Offset, Region};
use crate::window::{AccessError, MemoryWindow};

/// The reply of a handler that answered, and of one that could not reach the block.
const ANSWERED: u32 = 1;
const REFUSED: u32 = 0;

/// Sends requests of type `Q` and gets responses of type `R`, which are longer than a message,
/// through a block of the sender's own shared memory.
///
/// The block contains the request and, at the next cache line, the response; the message is the
/// block's offset. A block holds one request at a time. After a timeout the receiver may still
/// write to the block, so the exchange refuses further requests until the late reply has come or
/// the receiver is known to have ended. The receiver calls [`answer`].
///
/// ```
/// use std::time::Duration;
/// use condor_mbox::sim::SimSystem;
/// use condor_mbox::exchange::answer;
/// use condor_mbox::{
///     Call, Exchange, MemoryWindow, Messenger, Allocator, Processor, Region, Vector,
/// };
///
/// const CONTROLLER: Processor = Processor(0);
/// const HOST: Processor = Processor(1);
/// const SET_GAINS: Vector = Vector(20);
///
/// #[derive(zerocopy::FromBytes, zerocopy::IntoBytes, zerocopy::Immutable)]
/// #[repr(C)]
/// struct Gains {
///     joint: u32,
///     proportional: f32,
///     derivative: f32,
/// }
///
/// let system = SimSystem::<2>::in_real_time(4096);
///
/// // The controller reads the request from the sender's data, and writes the response there.
/// let data = system.windows(CONTROLLER).map(|windows| Region::users(windows.data).unwrap());
/// let set_gains = |call: &Call<'_>| {
///     answer(call, &data[call.sender().index()], |gains: Gains| gains.proportional * 2.0)
/// };
/// let mut controller = system.mailbox(CONTROLLER)?;
/// controller.set_vector(SET_GAINS, &set_gains, "set gains")?;
/// controller.join()?;
///
/// let mut host = system.mailbox(HOST)?;
/// host.join()?;
/// let host = &host;
/// std::thread::scope(|threads| {
///     threads.spawn(move || controller.serve(Duration::from_secs(10)));
///     let own = host.region(HOST)?;
///     let mut allocator = Allocator::new(own.size());
///     let mut exchange = Exchange::<_, _, Gains, f32>::new(host, own, &mut allocator)?;
///     let gains = Gains { joint: 3, proportional: 1.5, derivative: 0.1 };
///     let doubled = exchange.call(CONTROLLER, SET_GAINS, &gains, Duration::from_secs(10))?;
///     assert_eq!(doubled.to_bits(), 3.0_f32.to_bits());
///     Ok::<(), Box<dyn std::error::Error>>(())
/// })?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Exchange<'m, M: Messenger + ?Sized, W, Q, R> {
    messenger: &'m M,
    own: Region<W>,
    offset: u32,
    /// The request that was given up while its reply was still to come.
    late: Option<MessageTicket<'m>>,
    of: PhantomData<fn(Q) -> R>,
}

/// The error of [`Exchange::call`], which then returns no response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExchangeError {
    /// The message was not answered, for this reason.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
    /// The sender itself cannot access the block.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The reply to an earlier request has not come yet, and the block still belongs to that
    /// request.
    #[error(
        "the block of the request still belongs to an earlier request, whose reply has not come; try again later"
    )]
    InDoubt,
    /// The receiver could not access the block.
    #[error(
        "{to} could not access the block of the request, at offset {offset:#x} of the sender's memory"
    )]
    Refused {
        /// The processor to which the request was sent.
        to: Processor,
        /// The offset of the block, in bytes.
        offset: u32,
    },
}

impl<'m, M, W, Q, R> Exchange<'m, M, W, Q, R>
where
    M: Messenger + ?Sized,
    W: MemoryWindow,
    Q: FromBytes + IntoBytes + Immutable,
    R: FromBytes + IntoBytes + Immutable,
{
    /// The size of an exchange's block in shared memory, in bytes: the request, rounded up to whole
    /// cache lines, and the response.
    pub const BYTES: usize = response_at::<Q>(0) as usize + size_of::<R>();

    /// Makes an exchange that sends requests by `messenger`.
    ///
    /// `own` is the users' region of the sender's own `data`. The exchange takes its block from
    /// `allocator`, that of this region.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if `allocator` has no room for [`Self::BYTES`].
    pub fn new(
        messenger: &'m M,
        own: Region<W>,
        allocator: &mut Allocator,
    ) -> Result<Self, AccessError> {
        let offset = allocator.bytes(Self::BYTES)?;
        Ok(Self {
            messenger,
            own,
            offset,
            late: None,
            of: PhantomData,
        })
    }

    /// Sends `request` to `vector` of the processor `to`, and waits for the response for at most
    /// `timeout`; serves messages meanwhile.
    ///
    /// # Errors
    /// [`ExchangeError::Mailbox`] with the errors of [`Messenger::send_with_reply`] if there is no
    /// reply; [`ExchangeError::InDoubt`] if an earlier request timed out and its reply has still
    /// not come; [`ExchangeError::Refused`] if the receiver could not access the block;
    /// [`ExchangeError::Access`] if the sender could not.
    pub fn call(
        &mut self,
        to: Processor,
        vector: Vector,
        request: &Q,
        timeout: Duration,
    ) -> Result<R, ExchangeError> {
        if let Some(late) = &mut self.late
            && late.poll() == Ok(None)
        {
            return Err(ExchangeError::InDoubt);
        }
        self.late = None;
        self.own.set(Offset::at(self.offset), request)?;
        let deadline = self.messenger.now().after(timeout);
        let mut ticket = self.messenger.begin(to, vector, self.offset, timeout)?;
        let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
        match ticket.wait(left) {
            Ok(Some(ANSWERED)) => Ok(self.own.get(Offset::at(response_at::<Q>(self.offset)))?),
            Ok(_) => Err(ExchangeError::Refused {
                to,
                offset: self.offset,
            }),
            Err(error) => {
                // After any other error nothing more is to come.
                if matches!(
                    error,
                    MailboxError::TimedOut { .. } | MailboxError::Stalled { .. }
                ) {
                    self.late = Some(ticket);
                }
                Err(error.into())
            }
        }
    }
}

/// Answers the request of an [`Exchange`] in the handler that gets its message as `call`. Returns
/// the word that the handler must return: it tells the exchange whether the response was written.
///
/// `data_of_sender` is the users' region of the sender's `data`. The request is copied once and
/// then passed to `respond`, so later changes by the sender have no effect. If the block does not
/// lie in the region, the caller gets [`ExchangeError::Refused`].
pub fn answer<Q, R, W: MemoryWindow>(
    call: &Call<'_>,
    data_of_sender: &Region<W>,
    respond: impl FnOnce(Q) -> R,
) -> u32
where
    Q: FromBytes + IntoBytes + Immutable,
    R: FromBytes + IntoBytes + Immutable,
{
    let response = Offset::<R>::at(response_at::<Q>(call.data()));
    let Ok(request) = data_of_sender.get(Offset::<Q>::at(call.data())) else {
        return REFUSED;
    };
    match data_of_sender.set(response, &respond(request)) {
        Ok(()) => ANSWERED,
        Err(_) => REFUSED,
    }
}

/// Returns the offset of the response in a block at `offset`: it begins on the line after the request.
const fn response_at<Q>(offset: u32) -> u32 {
    // A block that would reach past the end of all windows is refused at its first access.
    offset.saturating_add((size_of::<Q>() as u32).div_ceil(LINE).saturating_mul(LINE))
}
