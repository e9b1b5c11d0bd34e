//! [`VariableServer`]: answers requests, in the background or in an interrupt of the table's owner.

use core::fmt;
use core::ops::Range;
use core::time::Duration;

use condor_mbox::{
    AccessError, Call, Exclusion, LoadOrder, MemoryWindow, Processor, Region, StoreOrder,
};

use crate::catalog::Catalog;
use crate::client::{RequestError, refusal};
use crate::kind::ValueKind;
use crate::layout::{Block, Shape, operation, response, slot};
use crate::param::{ParamRefusal, Tune};
use crate::selections::{Plan, Selections, Slot};
use crate::sync::Ordering::Relaxed;
use crate::table::VariableTable;
use crate::watcher::Watcher;

/// The part of a [`Selections`] that answers requests of other programs to watch the variables of a
/// loop and to set its parameters. Pass the servers of all loops to [`answer`].
pub struct VariableServer<'e, W, X, const N: usize> {
    pub(crate) selections: &'e Selections<N>,
    pub(crate) table: Region<W>,
    pub(crate) offset: u32,
    pub(crate) table_incarnation: u32,
    pub(crate) shape: Shape,
    pub(crate) catalog: Catalog<'e>,
    pub(crate) exclusion: X,
    pub(crate) incarnation: &'e (dyn Fn(Processor) -> u32 + Sync),
}

/// Answers a request about the variables or parameters of any loop of a program. Returns the word
/// with which the message handler must reply. Call it in the handler of the vector for requests,
/// such as [`VARS`](crate::VARS); the handler needs to do nothing else.
///
/// `data_of_sender` is the users' region of the sender's `data`. `servers` are the servers of all loops. If no server
/// has the requested table, the response says so.
pub fn answer<W: MemoryWindow>(
    call: &Call<'_>,
    data_of_sender: &Region<W>,
    servers: &[&dyn Respond],
) -> u32 {
    condor_mbox::exchange::answer(call, data_of_sender, |request: Block| {
        let [_, table, ..] = request;
        let server = servers.iter().find(|server| server.offset() == table);
        server.map_or([response::NO_TABLE, 0, 0, 0, 0, 0, 0, 0], |server| {
            server.respond(call.sender(), &request)
        })
    })
}

/// The operations of a [`VariableServer`] without its type parameters, so that the servers of several loops fit into
/// one list.
pub trait Respond: Sync {
    /// Returns the offset of the table in bytes, from the beginning of the users' region, by which
    /// programs address it.
    fn offset(&self) -> u32;

    /// Returns the response to a request, as [`layout`](crate::layout) describes both.
    fn respond(&self, sender: Processor, request: &[u32; 8]) -> [u32; 8];
}

/// The words of a response after "done", or another response.
type Outcome = Result<[u32; 2], RefusalBlock>;

/// A response other than "done".
struct RefusalBlock(Block);

impl From<AccessError> for RefusalBlock {
    fn from(_: AccessError) -> Self {
        Self([response::ACCESS, 0, 0, 0, 0, 0, 0, 0])
    }
}

const fn refused<T>(code: u32, [[a, b], [c, d]]: [[u32; 2]; 2]) -> Result<T, RefusalBlock> {
    Err(RefusalBlock([code, a, b, c, d, 0, 0, 0]))
}

const fn refused_with<T>(code: u32, first: u32, second: u32) -> Result<T, RefusalBlock> {
    refused(code, [[first, second], [0; 2]])
}

impl<W, X, const N: usize> Respond for VariableServer<'_, W, X, N>
where
    W: MemoryWindow + Sync,
    X: Exclusion + Sync,
{
    fn offset(&self) -> u32 {
        self.offset
    }

    fn respond(&self, sender: Processor, request: &[u32; 8]) -> [u32; 8] {
        match self.outcome(sender, *request) {
            Ok([a, b]) => [response::DONE, a, b, 0, 0, 0, 0, 0],
            Err(RefusalBlock(response)) => response,
        }
    }
}

impl<W, X, const N: usize> VariableServer<'_, W, X, N>
where
    W: MemoryWindow + Sync,
    X: Exclusion + Sync,
{
    /// Makes a watcher for the program that has this server, without sending a message. `own` is
    /// the number of the processor on which the program runs. Claims a slot of `table` and selects
    /// `entries` by number, as [`VariableClient`](crate::VariableClient) does by message. The loop
    /// writes a row every `every` ticks (at least 1); the first row is that of the next tick.
    ///
    /// # Errors
    /// Returns [`RequestError::NoSlot`] if all slots are taken, [`RequestError::Scattered`] if the selection
    /// has too many pieces, [`RequestError::Table`] if an entry does not exist, the table was made anew or
    /// `table` cannot be read, [`RequestError::Busy`] if another request is being answered or the loop has not
    /// taken over the last selection of the slot, [`RequestError::Protocol`] if the server cannot access its
    /// table.
    pub fn watch<V: MemoryWindow + Clone>(
        &self,
        table: &VariableTable<V>,
        own: Processor,
        entries: &[u32],
        every: u32,
    ) -> Result<Watcher<V>, RequestError> {
        let ask = |operation, number, claim, every| {
            let incarnation = table.incarnation();
            let request = [
                operation,
                self.offset,
                incarnation,
                number,
                claim,
                every,
                0,
                0,
            ];
            match self.respond(own, &request) {
                [response::DONE, a, b, ..] => Ok((a, b)),
                response => {
                    let (kind, timeout) = (ValueKind::U32, Duration::ZERO);
                    Err(refusal(&request, &response, own, kind, timeout))
                }
            }
        };
        let (slot, claim) = ask(operation::CLAIM, 0, 0, 0)?;
        let (to, code) = (own, response::DONE);
        let watcher = Watcher::new(table.clone(), slot, claim);
        let mut watcher = watcher.ok_or(RequestError::Protocol { to, code })?;
        watcher.choose(entries)?;
        let (selection, words) = ask(operation::SELECT, slot, claim, every)?;
        watcher.follow(selection, words);
        Ok(watcher)
    }
}

impl<'e, W: MemoryWindow, X: Exclusion, const N: usize> VariableServer<'e, W, X, N> {
    fn outcome(
        &self,
        sender: Processor,
        [operation, _, table_incarnation, number, a, b, c, d]: Block,
    ) -> Outcome {
        if table_incarnation != self.table_incarnation {
            return refused_with(response::RESTARTED, self.table_incarnation, 0);
        }
        match operation {
            operation::CLAIM => self.alone(|| self.claim(sender)),
            operation::SELECT => self.alone(|| self.select(number, a, b)),
            operation::RELEASE => self.alone(|| self.release(number, a)),
            operation::GET => {
                let (param, index) = self.param(number)?;
                Ok(self.exclusion.with(|| param.wanted(index)))
            }
            operation::INITIAL => {
                let (param, index) = self.param(number)?;
                Ok(param.initial(index))
            }
            operation::SET => self.set(number, [a, b], [c, d]),
            _ => refused_with(response::NO_OPERATION, operation, 0),
        }
    }

    /// Runs `body`, unless this handler has interrupted another one that is inside of `alone`.
    fn alone(&self, body: impl FnOnce() -> Outcome) -> Outcome {
        // Accessed inside of critical sections only, which order the accesses.
        let is_taken = &self.selections.is_taken;
        let is_mine = self.exclusion.with(|| {
            let is_free = is_taken.load(Relaxed) == 0;
            is_taken.store(1, Relaxed);
            is_free
        });
        if !is_mine {
            return refused_with(response::BUSY, 0, 0);
        }
        let outcome = body();
        self.exclusion.with(|| is_taken.store(0, Relaxed));
        outcome
    }

    fn claim(&self, sender: Processor) -> Outcome {
        let is_free = |slot: &Slot<N>| {
            // A processor's number was stored, so it fits.
            let owner = Processor(slot.owner.load(Relaxed) as u8);
            let incarnation = slot.incarnation.load(Relaxed);
            incarnation == 0 || incarnation != (self.incarnation)(owner)
        };
        let mut slots = (0..self.shape.slots).zip(&self.selections.slots);
        let Some((number, slot)) = slots.find(|(_, slot)| is_free(slot)) else {
            return refused_with(response::NO_SLOT, self.shape.slots, 0);
        };
        let claim = slot.claim.load(Relaxed).checked_add(1).unwrap_or(1);
        self.set_claim(number, claim)?;
        slot.claim.store(claim, Relaxed);
        slot.owner.store(sender.0.into(), Relaxed);
        slot.incarnation.store((self.incarnation)(sender), Relaxed);
        Ok([number, claim])
    }

    fn release(&self, number: u32, claim: u32) -> Outcome {
        let slot = self.claimed(number, claim)?;
        let Some(selection) = slot.next_selection() else {
            return refused_with(response::BUSY, 0, 0);
        };
        slot.plan(selection).words.store(0, Relaxed);
        slot.ask(selection);
        self.set_claim(number, 0)?;
        slot.incarnation.store(0, Relaxed);
        Ok([0; 2])
    }

    fn select(&self, number: u32, claim: u32, every: u32) -> Outcome {
        let slot = self.claimed(number, claim)?;
        let Some(selection) = slot.next_selection() else {
            return refused_with(response::BUSY, 0, 0);
        };
        let plan = slot.plan(selection);
        let words = self.plan(number, plan)?;
        plan.every.store(every.max(1), Relaxed);
        plan.words.store(words, Relaxed);
        slot.ask(selection);
        Ok([selection, words])
    }

    fn set(&self, number: u32, expected: [u32; 2], new: [u32; 2]) -> Outcome {
        let (param, index) = self.param(number)?;
        let set = || param.compare_and_set_words(index, expected, new);
        match self.exclusion.with(set) {
            Ok(()) => Ok([0; 2]),
            Err(ParamRefusal::Conflict {
                present: [low, high],
            }) => refused_with(response::CONFLICT, low, high),
            Err(ParamRefusal::OutOfBounds) => {
                let bounds = param.describe(index).map_or([[0; 2]; 2], |it| it.bounds);
                refused(response::OUT_OF_BOUNDS, bounds)
            }
        }
    }

    /// Finds the parameters that have the entry of a number, and which of them it is.
    fn param(&self, number: u32) -> Result<(&'e dyn Tune, usize), RefusalBlock> {
        let entries = self.shape.entries;
        if number >= entries {
            return refused_with(response::NO_ENTRY, entries, 0);
        }
        // Parameters come last.
        let mut from_end = (entries - number) as usize;
        for &param in self.catalog.params().iter().rev() {
            let most = param.words().len();
            let count = (0..most)
                .take_while(|&index| param.describe(index).is_some())
                .count();
            match count.checked_sub(from_end) {
                Some(index) => return Ok((param, index)),
                None => from_end -= count,
            }
        }
        refused_with(response::NO_PARAM, 0, 0)
    }

    fn claimed(&self, number: u32, claim: u32) -> Result<&'e Slot<N>, RefusalBlock> {
        let slots = self.selections.slots.get(..self.shape.slots as usize);
        let slot = slots.and_then(|slots| slots.get(number as usize));
        let is_claimed = |slot: &&Slot<N>| {
            slot.incarnation.load(Relaxed) != 0 && slot.claim.load(Relaxed) == claim
        };
        match slot.filter(is_claimed) {
            Some(slot) => Ok(slot),
            None => refused_with(response::NOT_YOURS, 0, 0),
        }
    }

    fn set_claim(&self, number: u32, claim: u32) -> Result<(), AccessError> {
        let at = self.shape.slot(number) + slot::CLAIM;
        // Pairs with the watcher's load of its claim.
        self.table.store(at, claim, StoreOrder::Release)
    }

    /// Makes a plan of the mask in a slot, each of whose words is read once; returns the number of words of
    /// values in a row.
    fn plan(&self, number: u32, plan: &Plan<N>) -> Result<u32, RefusalBlock> {
        let mask = self.shape.slot(number) + slot::MASK;
        let (mut entry, mut bits, mut words) = (0, 0, 0);
        let mut pieces = Pieces {
            plan,
            count: 0,
            whole: (0, 0, 0),
        };
        for (number, block) in self.catalog.blocks().enumerate() {
            let len = block.words().len();
            let (mut at, mut index, mut part) = (0, 0, 0..0);
            while at < len {
                if entry % 32 == 0 {
                    bits = self.table.load(mask + entry / 8, LoadOrder::Relaxed)?;
                }
                let size = block.describe(index).map_or(len, |it| it.kind.words());
                if bits & 1 << (entry % 32) != 0 {
                    if part.end != at {
                        pieces.put(number, part, len);
                        part = at..at;
                    }
                    part.end = at + size;
                    words += size as u32;
                }
                (at, index, entry) = (at + size, index + 1, entry + 1);
            }
            pieces.put(number, part, len);
        }
        let used = entry % 32;
        if used != 0 && bits >> used != 0 {
            return refused_with(response::NO_ENTRY, self.shape.entries, 0);
        }
        if pieces.count > N {
            return refused_with(response::SCATTERED, pieces.count as u32, N as u32);
        }
        plan.count.store(pieces.count as u32, Relaxed);
        Ok(words)
    }
}

/// A writer of the pieces of a plan, which joins neighbours into as few pieces as possible.
struct Pieces<'p, const N: usize> {
    plan: &'p Plan<N>,
    /// The number of pieces, even of those for which the plan has no room.
    count: usize,
    /// The last piece of whole blocks: its first block, the end of its blocks, and its number of words.
    whole: (usize, usize, usize),
}

impl<const N: usize> Pieces<'_, N> {
    /// Adds the words `part` of the block with index `block`, which has `len` words.
    fn put(&mut self, block: usize, part: Range<usize>, len: usize) {
        if part.is_empty() {
            return;
        }
        let (mut first, mut packed) = (block, (part.start, part.end));
        if part == (0..len) {
            packed = (len, 0);
            if self.whole.1 == block && block > 0 {
                // The last piece becomes longer.
                self.count -= 1;
                (first, packed.0) = (self.whole.0, self.whole.2 + len);
            }
            self.whole = (first, block + 1, packed.0);
        }
        // Numbers below 2^16.
        let pack = |(low, high): (usize, usize)| (high as u32) << 16 | low as u32;
        let places = self
            .plan
            .blocks
            .get(self.count)
            .zip(self.plan.parts.get(self.count));
        if let Some((blocks, parts)) = places {
            blocks.store(pack((first, block + 1)), Relaxed);
            parts.store(pack(packed), Relaxed);
        }
        self.count += 1;
    }
}

impl<W, X, const N: usize> fmt::Debug for VariableServer<'_, W, X, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Server")
            .field("offset", &self.offset)
            .field("table_incarnation", &self.table_incarnation)
            .field("catalog", &self.catalog)
            .finish_non_exhaustive()
    }
}
