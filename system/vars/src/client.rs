//! [`VariableClient`]: asks the loops of another processor's program.

use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{
    AccessError, Allocator, Exchange, MemoryWindow, Messenger, Processor, Region, Vector,
};

use crate::kind::{AnyValue, ValueKind};
use crate::layout::{Block, operation, response};
use crate::table::{TableEntry, VariableTable, VariableTableError};
use crate::watcher::Watcher;

/// A client through which a program watches the variables of the loops of one other processor, and
/// sets their parameters.
///
/// Each call sends a request as a message, waits for the reply, and serves messages meanwhile.
///
/// ```
/// use condor_mbox::{MemoryWindow, Messenger};
/// use condor_vars::{AnyValue, VariableClient, VariableTable};
///
/// /// Doubles the stiffness of a joint.
/// fn stiffen<W: MemoryWindow>(
///     client: &mut VariableClient<'_, impl Messenger, W>,
///     table: &VariableTable<W>,
/// ) -> Result<(), Box<dyn std::error::Error>> {
///     let soon = std::time::Duration::from_secs(1);
///     let entry = table.find("joint.stiffness")?.ok_or("no such parameter")?;
///     let AnyValue::F64(now) = client.get(table, &entry, soon)? else { return Ok(()) };
///     client.set(table, &entry, AnyValue::F64(now), AnyValue::F64(2.0 * now), soon)?;
///     Ok(())
/// }
/// ```
#[derive(Debug)]
pub struct VariableClient<'m, M: Messenger + ?Sized, W> {
    exchange: Exchange<'m, M, W, Block, Block>,
    messenger: &'m M,
    to: Processor,
    vector: Vector,
}

/// The reason why a request of a [`VariableClient`] has failed. The owner is the program that has
/// the table and runs the loop.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The message could not be sent, or was not answered.
    #[error(transparent)]
    Exchange(#[from] ExchangeError),
    /// The table cannot be read, or has been made anew.
    #[error(transparent)]
    Table(#[from] VariableTableError),
    /// The owner was busy until the deadline: the loop had not taken over the last selection, or
    /// another request was being answered.
    #[error("{to} was busy with another request for {} ms; try again", .timeout.as_millis())]
    Busy {
        /// The processor of the owner.
        to: Processor,
        /// The timeout of the call.
        timeout: Duration,
    },
    /// The program of that processor has no table at this offset.
    #[error("{to} has no table of variables at offset {offset:#x}")]
    NoTable {
        /// The processor of the owner.
        to: Processor,
        /// The offset of the table in bytes, in the users' region of the owner.
        offset: u32,
    },
    /// All slots belong to watchers that are alive.
    #[error(
        "all {slots} slots for watchers are in use: end another program that watches this loop"
    )]
    NoSlot {
        /// The number of slots.
        slots: u32,
    },
    /// The owner considered this watcher dead, and another watcher has claimed its slot.
    #[error("slot {slot} of this watcher was given to another watcher; claim a slot again")]
    Displaced {
        /// The number of the slot.
        slot: u32,
    },
    /// The selected variables lie in more pieces than the owner has room for; see
    /// [`Selections`](crate::Selections).
    #[error(
        "the selected variables lie in {pieces} pieces of memory; {most} is the most: select fewer, or all that \
     lie between them, too"
    )]
    Scattered {
        /// The number of pieces of the selection.
        pieces: u32,
        /// The greatest number of pieces.
        most: u32,
    },
    /// The entry is a variable, not a parameter.
    #[error("entry {number} is not a parameter and cannot be set")]
    NoParam {
        /// The number of the entry.
        number: u32,
    },
    /// The value is of another type than the parameter, or does not fit in it.
    #[error("the value {value} is not of type {kind}")]
    WrongKind {
        /// The value that does not fit.
        value: AnyValue,
        /// The type of the parameter.
        kind: ValueKind,
    },
    /// The value is not within the bounds.
    #[error("the value is out of bounds; it must be from {least} to {greatest}")]
    OutOfBounds {
        /// The least value.
        least: AnyValue,
        /// The greatest value.
        greatest: AnyValue,
    },
    /// The parameter does not have the expected value: another program has changed it.
    #[error(
        "the parameter was not set: its present value is {present}, not the one that the caller expected"
    )]
    Conflict {
        /// The value that was accepted last.
        present: AnyValue,
    },
    /// The response does not fit the request. Code 12 means that the owner could not access the memory of its
    /// table.
    #[error(
        "{to} answered with the unknown code {code}; build both programs from the same sources"
    )]
    Protocol {
        /// The processor of the owner.
        to: Processor,
        /// The first word of the response.
        code: u32,
    },
}

impl From<AccessError> for RequestError {
    fn from(error: AccessError) -> Self {
        Self::Table(error.into())
    }
}

/// The time between two requests to a busy owner.
const PAUSE: Duration = Duration::from_micros(200);

impl<'m, M: Messenger + ?Sized, W: MemoryWindow> VariableClient<'m, M, W> {
    /// The number of bytes that a client takes from the users' region of the processor on which it
    /// runs.
    pub const BYTES: usize = Exchange::<'m, M, Region<W>, Block, Block>::BYTES;

    /// Makes a client that sends its requests on `vector`, such as [`VARS`](crate::VARS), to the
    /// processor `to`. The client takes room for its requests from `allocator` in `own`, the users'
    /// region of the processor on which it runs.
    ///
    /// # Errors
    /// Returns [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub fn new(
        messenger: &'m M,
        own: Region<W>,
        allocator: &mut Allocator,
        to: Processor,
        vector: Vector,
    ) -> Result<Self, AccessError> {
        Ok(Self {
            exchange: Exchange::new(messenger, own, allocator)?,
            messenger,
            to,
            vector,
        })
    }

    /// Claims a slot of the loop that `table` describes. Returns a watcher, through which the
    /// loop's variables are selected and read. Waits for the reply for at most `timeout`.
    ///
    /// # Errors
    /// Returns [`RequestError::NoSlot`] if all slots are taken. All calls also return
    /// [`RequestError::Exchange`] if the message fails or times out, [`RequestError::Table`] if the table
    /// cannot be read or was made anew, [`RequestError::Busy`] if the owner is busy until the deadline,
    /// [`RequestError::NoTable`] if there is no table, and [`RequestError::Protocol`] if the response does not
    /// fit the request.
    pub fn claim<V: MemoryWindow + Clone>(
        &mut self,
        table: &VariableTable<V>,
        timeout: Duration,
    ) -> Result<Watcher<V>, RequestError> {
        let [number, claim] =
            self.ask(table, operation::CLAIM, 0, [0; 4], ValueKind::U32, timeout)?;
        let (to, code) = (self.to, response::DONE);
        Watcher::new(table.clone(), number, claim).ok_or(RequestError::Protocol { to, code })
    }

    /// Selects the variables that `watcher` reads: `entries` are the numbers of their entries in
    /// the table. From then on the loop writes a row with their values every `every` ticks (at
    /// least 1); the values are in the order of the entries' numbers. Rows of the former selection
    /// that were not read are dropped.
    ///
    /// The first row is that of the first tick after the loop has taken over the selection.
    ///
    /// # Errors
    /// Returns [`RequestError::Scattered`] if the selection has too many pieces, [`RequestError::Displaced`] if
    /// the slot has gone to another watcher, the errors of [`VariableTable::entry`], and the errors of all
    /// calls (see [`claim`](Self::claim)). Nothing is selected then.
    pub fn select<V: MemoryWindow>(
        &mut self,
        watcher: &mut Watcher<V>,
        entries: &[u32],
        every: u32,
        timeout: Duration,
    ) -> Result<(), RequestError> {
        let words = watcher.choose(entries)?;
        let (number, arguments) = (watcher.slot(), [watcher.claim(), every, 0, 0]);
        let table = watcher.table();
        let [selection, found] = self.ask(
            table,
            operation::SELECT,
            number,
            arguments,
            ValueKind::U32,
            timeout,
        )?;
        if found != words {
            let (to, code) = (self.to, response::DONE);
            return Err(RequestError::Protocol { to, code });
        }
        watcher.follow(selection, words);
        Ok(())
    }

    /// Releases the slot of `watcher`, so that another program can claim it. The watcher cannot be
    /// used any more.
    ///
    /// # Errors
    /// Returns [`RequestError::Displaced`] if the slot has gone to another watcher, and the errors of all calls
    /// (see [`claim`](Self::claim)).
    pub fn release<V: MemoryWindow>(
        &mut self,
        watcher: &mut Watcher<V>,
        timeout: Duration,
    ) -> Result<(), RequestError> {
        watcher.end();
        let (number, arguments) = (watcher.slot(), [watcher.claim(), 0, 0, 0]);
        let table = watcher.table();
        self.ask(
            table,
            operation::RELEASE,
            number,
            arguments,
            ValueKind::U32,
            timeout,
        )?;
        Ok(())
    }

    /// Returns the value of the parameter `entry` that was accepted last. The loop takes it over at
    /// its next tick, and may still use the value before it.
    ///
    /// # Errors
    /// Returns [`RequestError::NoParam`] if the entry is not a parameter, and the errors of all calls (see
    /// [`claim`](Self::claim)).
    pub fn get<V: MemoryWindow>(
        &mut self,
        table: &VariableTable<V>,
        entry: &TableEntry,
        timeout: Duration,
    ) -> Result<AnyValue, RequestError> {
        let words = self.ask(
            table,
            operation::GET,
            entry.number,
            [0; 4],
            entry.kind,
            timeout,
        )?;
        Ok(entry.kind.value(words))
    }

    /// Returns the value with which the parameter `entry` began when its program was started.
    ///
    /// # Errors
    /// Returns the errors of [`get`](Self::get).
    pub fn initial<V: MemoryWindow>(
        &mut self,
        table: &VariableTable<V>,
        entry: &TableEntry,
        timeout: Duration,
    ) -> Result<AnyValue, RequestError> {
        let (number, kind) = (entry.number, entry.kind);
        let words = self.ask(table, operation::INITIAL, number, [0; 4], kind, timeout)?;
        Ok(kind.value(words))
    }

    /// Changes the parameter `entry` from `expected` to `new`. The loop uses the new value from its
    /// next tick on.
    ///
    /// After a timeout the parameter may have either value; [`get`](Self::get) returns the present value.
    ///
    /// # Errors
    /// Returns [`RequestError::WrongKind`] if a value does not fit the parameter's type,
    /// [`RequestError::OutOfBounds`] if `new` is out of bounds, [`RequestError::Conflict`] if the present value
    /// is not `expected`, [`RequestError::NoParam`] if the entry is not a parameter, and the errors of all
    /// calls (see [`claim`](Self::claim)).
    pub fn set<V: MemoryWindow>(
        &mut self,
        table: &VariableTable<V>,
        entry: &TableEntry,
        expected: AnyValue,
        new: AnyValue,
        timeout: Duration,
    ) -> Result<(), RequestError> {
        let kind = entry.kind;
        let words = |value| {
            let wrong = RequestError::WrongKind { value, kind };
            kind.words_of(value).ok_or(wrong)
        };
        let ([a, b], [c, d]) = (words(expected)?, words(new)?);
        self.ask(
            table,
            operation::SET,
            entry.number,
            [a, b, c, d],
            kind,
            timeout,
        )?;
        Ok(())
    }

    fn ask<V: MemoryWindow>(
        &mut self,
        table: &VariableTable<V>,
        operation: u32,
        number: u32,
        [a, b, c, d]: [u32; 4],
        kind: ValueKind,
        timeout: Duration,
    ) -> Result<[u32; 2], RequestError> {
        let deadline = self.messenger.now().after(timeout);
        let (to, offset, expected) = (self.to, table.offset(), table.incarnation());
        let request = [operation, offset, expected, number, a, b, c, d];
        loop {
            let left = Duration::from_nanos(deadline.ns_since(self.messenger.now()));
            let response = self.exchange.call(to, self.vector, &request, left)?;
            match response {
                [response::DONE, a, b, ..] => return Ok([a, b]),
                [response::BUSY, ..] if left > PAUSE => {
                    let served = self.messenger.serve(PAUSE);
                    served.map_err(ExchangeError::from)?;
                }
                _ => return Err(refusal(&request, &response, to, kind, timeout)),
            }
        }
    }
}

/// Returns the error for a response with which the owner of a table, the processor `to`, has refused a request.
pub(crate) fn refusal(
    &[_, offset, expected, number, ..]: &Block,
    &[code, a, b, c, d, ..]: &Block,
    to: Processor,
    kind: ValueKind,
    timeout: Duration,
) -> RequestError {
    match code {
        response::BUSY => RequestError::Busy { to, timeout },
        response::NO_TABLE => RequestError::NoTable { to, offset },
        response::RESTARTED => VariableTableError::Restarted { found: a, expected }.into(),
        response::NO_SLOT => RequestError::NoSlot { slots: a },
        response::NOT_YOURS => RequestError::Displaced { slot: number },
        response::NO_ENTRY => VariableTableError::NoEntry { number, entries: a }.into(),
        response::SCATTERED => RequestError::Scattered { pieces: a, most: b },
        response::NO_PARAM => RequestError::NoParam { number },
        response::OUT_OF_BOUNDS => RequestError::OutOfBounds {
            least: kind.value([a, b]),
            greatest: kind.value([c, d]),
        },
        response::CONFLICT => RequestError::Conflict {
            present: kind.value([a, b]),
        },
        code => RequestError::Protocol { to, code },
    }
}
