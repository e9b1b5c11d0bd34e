use condor_mbox::{AccessError, Call, Exclusion, MemoryWindow, Places, Processor, Region, Vector};

use super::object::{Asked, MonitorObject, word};
use super::selection::{MASK_WORDS, Selection, SelectionError};

/// The vector of a processor for requests to its monitor.
///
/// A request is a block of [`MonitorPlaces`] in the users' region of the processor's `data`, one for
/// each processor of the system, and its offset the data of the message: 16 words, of which the first
/// is 1 to select, then every which tick makes a row, and the 8 words of the selection. The 16 words
/// after it are the response: 0 and the number of the selection; 1 if another request was being
/// answered; 16 and the word that is no verb; 17 for every 0 ticks; 18, the first variable that there
/// is not, and how many there are; 19, how many are chosen, and how many columns there are. The reply
/// is 1 once the response has been written, and 0 for an offset that is not the sender's.
pub const MONITOR: Vector = Vector(33);

pub(super) const WORDS: usize = 16;
pub(super) type Block = [u32; WORDS];
const BLOCK_BYTES: u32 = 2 * 4 * WORDS as u32;

pub(super) const SELECT: u32 = 1;
pub(super) const DONE: u32 = 0;
pub(super) const BUSY: u32 = 1;

/// Where a monitor's blocks and ring lie in the `data` of its processor; both sides make them with the
/// same numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MonitorPlaces {
    blocks: u32,
    processors: u32,
    ring: u32,
    ring_bytes: u32,
}

impl MonitorPlaces {
    /// The next of `places`, for requests from `processors` and a ring in
    /// [`ring_bytes`](super::ring_bytes).
    ///
    /// # Errors
    /// `OutOfBounds` if there is no room.
    pub const fn new(
        places: &mut Places,
        processors: u8,
        ring_bytes: u32,
    ) -> Result<Self, AccessError> {
        let blocks = match places.bytes(processors as usize * BLOCK_BYTES as usize) {
            Ok(offset) => offset,
            Err(error) => return Err(error),
        };
        let ring = match places.bytes(ring_bytes as usize) {
            Ok(offset) => offset,
            Err(error) => return Err(error),
        };
        Ok(Self {
            blocks,
            processors: processors as u32,
            ring,
            ring_bytes: ring_bytes & !3,
        })
    }

    /// The region of the ring, for a reader.
    ///
    /// # Errors
    /// `OutOfBounds` if it does not lie in `region`.
    pub fn ring<W: MemoryWindow + Clone>(
        &self,
        region: &Region<W>,
    ) -> Result<Region<W>, AccessError> {
        region.part(self.ring, self.ring_bytes)
    }

    /// Where the block of requests from `sender` begins, in bytes.
    #[must_use]
    pub fn block(&self, sender: Processor) -> Option<u32> {
        let number = u32::from(sender.0);
        (number < self.processors).then(|| self.blocks.wrapping_add(number * BLOCK_BYTES))
    }
}

/// The end of a [`MonitorObject`] that answers messages, in the background of its processor.
#[derive(Debug)]
pub struct MonitorHandler<'o, W, X> {
    object: &'o MonitorObject,
    region: Region<W>,
    places: MonitorPlaces,
    exclusion: X,
    /// Variables and columns.
    capacity: (u32, u32),
}

impl<'o, W: MemoryWindow, X: Exclusion> MonitorHandler<'o, W, X> {
    pub(super) const fn new(
        object: &'o MonitorObject,
        region: Region<W>,
        places: MonitorPlaces,
        exclusion: X,
        capacity: (u32, u32),
    ) -> Self {
        Self {
            object,
            region,
            places,
            exclusion,
            capacity,
        }
    }

    /// Answers a message: all that the handler of [`MONITOR`] does.
    pub fn answer(&self, call: &Call<'_>) -> u32 {
        if self.places.block(call.sender()) != Some(call.data()) {
            return 0;
        }
        condor_mbox::exchange::answer(call, &self.region, |request: Block| {
            let mut response = Block::default();
            for (word, value) in response.iter_mut().zip(self.respond(&request)) {
                *word = value;
            }
            response
        })
    }

    fn respond(&self, request: &Block) -> [u32; 3] {
        let [verb, every, rest @ ..] = *request;
        if verb != SELECT {
            return [16, verb, 0];
        }
        let mask = rest.first_chunk::<MASK_WORDS>().copied();
        let selection = Selection {
            every,
            mask: mask.unwrap_or_default(),
        };
        let (variables, columns) = self.capacity;
        match selection.check(variables, columns) {
            Ok(()) => self
                .select(&selection)
                .map_or([BUSY, 0, 0], |number| [DONE, number, 0]),
            Err(error) => put_error(&error),
        }
    }

    /// Leaves a selection for the loop; none while another handler does so.
    fn select(&self, selection: &Selection) -> Option<u32> {
        let words = self.object.words();
        let mine = self.exclusion.with(|| {
            let is_free = words.word(word::DESK) == Ok(0);
            is_free && words.set_word(word::DESK, 1).is_ok()
        });
        if !mine {
            return None;
        }
        let number = self.publish(selection);
        words.set_word(word::DESK, 0).ok()?;
        number
    }

    fn publish(&self, selection: &Selection) -> Option<u32> {
        let words = self.object.words();
        let number = match words.word(word::NUMBER).ok()?.wrapping_add(1) {
            0 => 1,
            number => number,
        };
        let mut asked = Asked::default();
        let values = [number, selection.every].into_iter().chain(selection.mask);
        for (word, value) in asked.iter_mut().zip(values) {
            *word = value;
        }
        let (cell, window) = self.object.asked();
        // One handler at a time is here: a new publisher goes on where the last one stopped.
        cell.publisher(window).ok()?.publish(&asked).ok()?;
        words.set_word(word::NUMBER, number).ok()?;
        Some(number)
    }
}

fn put_error(error: &SelectionError) -> [u32; 3] {
    match *error {
        SelectionError::Every { every } => [17, every, 0],
        SelectionError::NoVariable {
            variable,
            variables,
        } => [18, variable, variables],
        SelectionError::Columns { chosen, columns } => [19, chosen, columns],
    }
}

/// The error in a response.
pub(super) fn take_error([code, a, b]: [u32; 3]) -> Option<SelectionError> {
    match code {
        17 => Some(SelectionError::Every { every: a }),
        18 => Some(SelectionError::NoVariable {
            variable: a,
            variables: b,
        }),
        19 => Some(SelectionError::Columns {
            chosen: a,
            columns: b,
        }),
        _ => None,
    }
}
