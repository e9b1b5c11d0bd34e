//! [`Server`]: the end that answers requests, in the background or an interrupt of the owner.

use core::fmt;

use condor_mbox::{
    AccessError, Call, Exclusion, LoadOrder, MemoryWindow, Processor, Region, StoreOrder,
};

use crate::catalog::Catalog;
use crate::desk::{Desk, Plan, Slot};
use crate::layout::{Block, Shape, response, slot, verb};
use crate::param::{Refusal, Tune};
use crate::sync::Ordering::Relaxed;

/// The end of a [`Desk`] in the handler of requests; see [`answer`].
pub struct Server<'e, W, X, const PIECES: usize, const SLOTS: usize> {
    desk: &'e Desk<PIECES, SLOTS>,
    table: Region<W>,
    offset: u32,
    life: u32,
    shape: Shape,
    catalog: Catalog<'e>,
    exclusion: X,
    incarnation: &'e (dyn Fn(Processor) -> u32 + Sync),
}

/// Answers a request to any of the loops of a program: all that the handler of its vector does.
///
/// `data_of_sender` is the users' region of the sender.
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

/// A [`Server`], whatever its types.
pub trait Respond: Sync {
    /// Returns where the table begins in the users' region: what people and programs find it by.
    fn offset(&self) -> u32;

    /// Returns the response to a request, as [`layout`](crate::layout) describes both.
    fn respond(&self, sender: Processor, request: &[u32; 8]) -> [u32; 8];
}

/// The words of a response after its code, or the code and the words of a refusal.
type Outcome = Result<[u32; 2], Refused>;

/// A response other than "done".
struct Refused(u32, [u32; 4]);

impl From<AccessError> for Refused {
    fn from(_: AccessError) -> Self {
        Self(response::ACCESS, [0; 4])
    }
}

const fn refused<T>(code: u32) -> Result<T, Refused> {
    Err(Refused(code, [0; 4]))
}

const fn refused_with<T>(code: u32, first: u32, second: u32) -> Result<T, Refused> {
    Err(Refused(code, [first, second, 0, 0]))
}

impl<W, X, const PIECES: usize, const SLOTS: usize> Respond for Server<'_, W, X, PIECES, SLOTS>
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
            Err(Refused(code, [a, b, c, d])) => [code, a, b, c, d, 0, 0, 0],
        }
    }
}

impl<'e, W: MemoryWindow, X: Exclusion, const PIECES: usize, const SLOTS: usize>
    Server<'e, W, X, PIECES, SLOTS>
{
    #[allow(clippy::too_many_arguments)] // of one caller
    pub(crate) fn new(
        desk: &'e Desk<PIECES, SLOTS>,
        table: Region<W>,
        offset: u32,
        life: u32,
        shape: Shape,
        catalog: Catalog<'e>,
        exclusion: X,
        incarnation: &'e (dyn Fn(Processor) -> u32 + Sync),
    ) -> Self {
        Self {
            desk,
            table,
            offset,
            life,
            shape,
            catalog,
            exclusion,
            incarnation,
        }
    }

    fn outcome(&self, sender: Processor, [verb, _, life, number, a, b, c, d]: Block) -> Outcome {
        if life != self.life {
            return refused_with(response::RESTARTED, self.life, 0);
        }
        match verb {
            verb::CLAIM => self.alone(|| self.claim(sender)),
            verb::SELECT => self.alone(|| self.select(number, a, b)),
            verb::RELEASE => self.alone(|| self.release(number, a)),
            verb::GET => {
                let param = self.param(number)?;
                Ok(self.exclusion.with(|| param.wanted()))
            }
            verb::SET => self.set(number, [a, b], [c, d]),
            _ => refused_with(response::NO_VERB, verb, 0),
        }
    }

    /// Runs `body` unless this interrupts another handler that is in there.
    fn alone(&self, body: impl FnOnce() -> Outcome) -> Outcome {
        // Inside of sections only, which order them.
        let is_taken = &self.desk.is_taken;
        let is_mine = self.exclusion.with(|| {
            let is_free = is_taken.load(Relaxed) == 0;
            is_taken.store(1, Relaxed);
            is_free
        });
        if !is_mine {
            return refused(response::BUSY);
        }
        let outcome = body();
        self.exclusion.with(|| is_taken.store(0, Relaxed));
        outcome
    }

    fn claim(&self, sender: Processor) -> Outcome {
        let is_free = |slot: &Slot<PIECES>| {
            // A processor's number was stored, so it fits.
            let owner = Processor(slot.owner.load(Relaxed) as u8);
            slot.claim.load(Relaxed) == 0
                || slot.incarnation.load(Relaxed) != (self.incarnation)(owner)
        };
        let found = self.desk.slots.iter().position(is_free);
        let Some((number, slot)) = found.and_then(|at| Some((at, self.desk.slots.get(at)?))) else {
            return refused_with(response::NO_SLOT, SLOTS as u32, 0);
        };
        let number = number as u32;
        let claim = match slot.last_claim.load(Relaxed).wrapping_add(1) {
            0 => 1,
            claim => claim,
        };
        self.set_claim(number, claim)?;
        slot.last_claim.store(claim, Relaxed);
        slot.claim.store(claim, Relaxed);
        slot.owner.store(sender.0.into(), Relaxed);
        slot.incarnation.store((self.incarnation)(sender), Relaxed);
        Ok([number, claim])
    }

    fn release(&self, number: u32, claim: u32) -> Outcome {
        let slot = self.claimed(number, claim)?;
        let Some(selection) = slot.next_selection() else {
            return refused(response::BUSY);
        };
        let plan = slot.plan(selection);
        plan.words.store(0, Relaxed);
        plan.count.store(0, Relaxed);
        slot.ask(selection);
        self.set_claim(number, 0)?;
        slot.claim.store(0, Relaxed);
        Ok([0; 2])
    }

    fn select(&self, number: u32, claim: u32, every: u32) -> Outcome {
        let slot = self.claimed(number, claim)?;
        if every == 0 {
            return refused(response::EVERY);
        }
        let Some(selection) = slot.next_selection() else {
            return refused(response::BUSY);
        };
        // Nobody reads it now: the loop has left it.
        let plan = slot.plan(selection);
        let words = self.plan(number, plan)?;
        plan.every.store(every, Relaxed);
        plan.words.store(words, Relaxed);
        slot.ask(selection);
        Ok([selection, words])
    }

    fn set(&self, number: u32, expected: [u32; 2], new: [u32; 2]) -> Outcome {
        let param = self.param(number)?;
        let set = || param.compare_and_set_words(expected, new);
        match self.exclusion.with(set) {
            Ok(()) => Ok([0; 2]),
            Err(Refusal::Conflict {
                present: [low, high],
            }) => refused_with(response::CONFLICT, low, high),
            Err(Refusal::OutOfBounds) => {
                let bounds = param.describe(0).map_or([[0; 2]; 2], |it| it.bounds);
                let [[a, b], [c, d]] = bounds;
                Err(Refused(response::OUT_OF_BOUNDS, [a, b, c, d]))
            }
        }
    }

    fn param(&self, number: u32) -> Result<&'e dyn Tune, Refused> {
        if number >= self.shape.entries {
            return refused_with(response::NO_ENTRY, self.shape.entries, 0);
        }
        let index = number.checked_sub(self.catalog.first_param(self.shape.entries));
        let param = index.and_then(|index| self.catalog.params().get(index as usize));
        param.copied().ok_or(Refused(response::NO_PARAM, [0; 4]))
    }

    fn claimed(&self, number: u32, claim: u32) -> Result<&'e Slot<PIECES>, Refused> {
        match self.desk.slots.get(number as usize) {
            Some(slot) if claim != 0 && slot.claim.load(Relaxed) == claim => Ok(slot),
            _ => refused(response::NOT_YOURS),
        }
    }

    fn set_claim(&self, number: u32, claim: u32) -> Result<(), AccessError> {
        let at = self.shape.slot(number) + slot::CLAIM;
        // Pairs with the watcher's look at its claim.
        self.table.store(at, claim, StoreOrder::Release)
    }

    /// Makes a plan of the mask in a slot, each of whose words is read once; returns the words of a row.
    fn plan(&self, number: u32, plan: &Plan<PIECES>) -> Result<u32, Refused> {
        let mask = self.shape.slot(number) + slot::MASK;
        let (mut entry, mut bits, mut words) = (0, 0, 0);
        let mut pieces = Pieces {
            plan,
            count: 0,
            whole: None,
            part: None,
        };
        for (number, block) in self.catalog.blocks().enumerate() {
            let len = block.words().len();
            let (mut at, mut index) = (0, 0);
            while at < len {
                if entry % 32 == 0 {
                    bits = self.table.load(mask + entry / 8, LoadOrder::Relaxed)?;
                }
                let size = block.describe(index).map_or(len, |it| it.kind.words());
                if bits & 1 << (entry % 32) != 0 {
                    pieces.add(number, at, at + size);
                    words += size as u32;
                }
                (at, index, entry) = (at + size, index + 1, entry + 1);
            }
            pieces.end_block(number, len);
        }
        pieces.put_whole();
        let used = entry % 32;
        if used != 0 && bits >> used != 0 {
            return refused_with(response::NO_ENTRY, self.shape.entries, 0);
        }
        if pieces.count > PIECES {
            return refused_with(response::SCATTERED, pieces.count as u32, PIECES as u32);
        }
        plan.count.store(pieces.count as u32, Relaxed);
        Ok(words)
    }
}

/// Puts the pieces of a plan together: as few as there can be.
struct Pieces<'p, const PIECES: usize> {
    plan: &'p Plan<PIECES>,
    /// How many there are, whether or not they had room.
    count: usize,
    /// Whole blocks to which the next may be added: the first, the end, and their words.
    whole: Option<(usize, usize, usize)>,
    /// Words of the present block to which the next may be added: the first, and the end.
    part: Option<(usize, usize)>,
}

impl<const PIECES: usize> Pieces<'_, PIECES> {
    /// Adds words of the present block.
    fn add(&mut self, block: usize, first: usize, end: usize) {
        match &mut self.part {
            Some(part) if part.1 == first => part.1 = end,
            _ => {
                self.put_part(block);
                self.part = Some((first, end));
            }
        }
    }

    fn end_block(&mut self, block: usize, len: usize) {
        if self.part != Some((0, len)) {
            self.put_part(block);
            return;
        }
        self.part = None;
        match &mut self.whole {
            Some((_, end, words)) if *end == block => (*end, *words) = (block + 1, *words + len),
            _ => {
                self.put_whole();
                self.whole = Some((block, block + 1, len));
            }
        }
    }

    fn put_part(&mut self, block: usize) {
        if let Some(part) = self.part.take() {
            self.put_whole();
            self.put((block, block + 1), part);
        }
    }

    fn put_whole(&mut self) {
        if let Some((first, end, words)) = self.whole.take() {
            self.put((first, end), (words, 0));
        }
    }

    fn put(&mut self, blocks: (usize, usize), part: (usize, usize)) {
        // Numbers below 2^16.
        let pack = |(low, high): (usize, usize)| (high as u32) << 16 | low as u32;
        let plan = self.plan;
        if let (Some(to), Some(to_part)) = (plan.blocks.get(self.count), plan.parts.get(self.count))
        {
            to.store(pack(blocks), Relaxed);
            to_part.store(pack(part), Relaxed);
        }
        self.count += 1;
    }
}

impl<W, X, const PIECES: usize, const SLOTS: usize> fmt::Debug for Server<'_, W, X, PIECES, SLOTS> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Server")
            .field("offset", &self.offset)
            .field("life", &self.life)
            .field("catalog", &self.catalog)
            .finish_non_exhaustive()
    }
}
