//! The memory of the two, and where things lie in the follower's `data` after the doorbell's line.

use condor_mbox::spin_lock::Bakery;
use condor_mbox::{AccessError, Allocator, Published, StaticMemory, Windows, layout};

use crate::{PROCESSORS, Window};

const MAIL_WORDS: usize = layout::mail_bytes(PROCESSORS as u32) as usize / 4;
const DATA_WORDS: usize = (layout::BELL_BYTES + USERS_BYTES) as usize / 4;
const USERS_BYTES: u32 = 1024 - layout::BELL_BYTES;

/// Returns the windows of both processors.
pub(crate) fn windows() -> [Windows<Window>; PROCESSORS] {
    static MAIL: [StaticMemory<MAIL_WORDS>; PROCESSORS] =
        [const { StaticMemory::new() }; PROCESSORS];
    static DATA: [StaticMemory<DATA_WORDS>; PROCESSORS] =
        [const { StaticMemory::new() }; PROCESSORS];
    let ([mail0, mail1], [data0, data1]) = (&MAIL, &DATA);
    [(mail0, data0), (mail1, data1)].map(|(mail, data)| Windows {
        mail: mail.window(),
        data: data.window(),
    })
}

/// A value that is published; all its words are equal.
pub(crate) type Sample = [u32; 6];

pub(crate) struct Map {
    /// A word for the leader to read.
    pub(crate) word: u32,
    /// The order that the follower must obey.
    pub(crate) order: u32,
    /// The order that the follower obeys.
    pub(crate) obeyed: u32,
    /// The two words that both count up.
    pub(crate) counted: u32,
    pub(crate) sample: Published<Sample>,
    /// The lock of the two words; that of loads and stores is the largest.
    pub(crate) lock: u32,
}

/// Found at compile time, so that both ends agree.
pub(crate) const MAP: Map = match map() {
    Ok(map) => map,
    Err(_) => panic!("the map is larger than its memory"),
};

const fn map() -> Result<Map, AccessError> {
    let mut allocator = Allocator::new(USERS_BYTES);
    macro_rules! take {
        ($place:expr) => {
            match $place {
                Ok(place) => place,
                Err(error) => return Err(error),
            }
        };
    }
    Ok(Map {
        word: take!(allocator.bytes(4)),
        order: take!(allocator.bytes(4)),
        obeyed: take!(allocator.bytes(4)),
        counted: take!(allocator.bytes(8)),
        sample: take!(allocator.published()),
        lock: take!(allocator.bytes(Bakery::bytes(PROCESSORS as u8))),
    })
}
