use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{AccessError, Exchange, MemoryWindow, Messenger, Places, Processor, Region};

use super::handler::{BUSY, Block, DONE, MONITOR, MonitorPlaces, SELECT, take_error};
use super::selection::{Selection, SelectionError};
use crate::decimal::Decimal;

/// How long a handler is left alone that looks at the selection of somebody else.
const PAUSE: Duration = Duration::from_micros(200);

/// Selects what the monitor of another processor samples, from the background of this one.
#[derive(Debug)]
pub struct MonitorClient<'m, M: Messenger + ?Sized, W> {
    exchange: Exchange<'m, M, Region<W>, Block, Block>,
    messenger: &'m M,
    to: Processor,
}

/// Why a monitor did not take a selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MonitorClientError {
    /// The message, or its answer.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The monitor cannot follow it.
    #[error(transparent)]
    Selection(#[from] SelectionError),
    /// Others kept the handler from looking at it.
    #[error("{to} was busy for {timeout} s", timeout = Decimal(.timeout.as_secs_f64()))]
    Busy {
        /// The processor.
        to: Processor,
        /// The time that was given.
        timeout: Duration,
    },
    /// A response that no monitor gives.
    #[error("{to} answered with the word {word:#x}")]
    Protocol {
        /// The processor.
        to: Processor,
        /// The first word.
        word: u32,
    },
}

impl<'m, M: Messenger + ?Sized, W: MemoryWindow + Clone> MonitorClient<'m, M, W> {
    /// A client of the monitor of `to`, in the users' region of whose `data` it has `places`.
    ///
    /// There must be only one on this processor at a time.
    ///
    /// # Errors
    /// `OutOfBounds` if the sender has no block in the places, or there is no room.
    pub fn new(
        messenger: &'m M,
        to: Processor,
        region: &Region<W>,
        places: MonitorPlaces,
    ) -> Result<Self, AccessError> {
        let mut left = Places::new(region.size());
        let block = places.block(messenger.number());
        left.bytes(block.unwrap_or(u32::MAX) as usize)?;
        let exchange = Exchange::new(messenger, Region::whole(region.clone()), &mut left)?;
        Ok(Self {
            exchange,
            messenger,
            to,
        })
    }

    /// Selects what is sampled from the next tick on; gives the number of the selection, which
    /// [`MonitorReader::selection_number`](super::MonitorReader::selection_number) tells once it is in
    /// force.
    ///
    /// # Errors
    /// See [`MonitorClientError`].
    pub fn select(
        &mut self,
        selection: &Selection,
        timeout: Duration,
    ) -> Result<u32, MonitorClientError> {
        let deadline = self.messenger.now().after(timeout);
        let mut request = Block::default();
        let values = [SELECT, selection.every].into_iter().chain(selection.mask);
        for (word, value) in request.iter_mut().zip(values) {
            *word = value;
        }
        let to = self.to;
        loop {
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            let [state, a, b, ..] = self.exchange.call(to, MONITOR, &request, left)?;
            match state {
                DONE => return Ok(a),
                BUSY if left.is_zero() => return Err(MonitorClientError::Busy { to, timeout }),
                BUSY => {
                    let served = self.messenger.serve(left.min(PAUSE));
                    served.map_err(ExchangeError::from)?;
                }
                word => {
                    let error = take_error([state, a, b]);
                    return Err(error.map_or(
                        MonitorClientError::Protocol { to, word },
                        MonitorClientError::Selection,
                    ));
                }
            }
        }
    }
}
