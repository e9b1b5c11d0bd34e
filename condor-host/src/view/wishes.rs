//! [`Wishes`]: what each visitor watches, told to all others.
//!
//! A monitor has one selection for all who watch, and does not know who they are. So each visitor
//! has in its own window, as `wishes` in its directory, what it watches of which processor; what it
//! asks a monitor for is all that living visitors, and programs, wish together. One that is killed
//! wishes nothing any more, without having said so.
//!
//! | offset | |
//! |---|---|
//! | 0 | the life of the visitor that has these wishes |
//! | 4 + 36 *p* | of the monitor of processor *p*: every which tick, 0 if nothing is watched; the selection, 8 words |

use condor_hand::monitor::{MonitorPlaces, Selection, VARIABLES};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{
    AccessError, LoadOrder, MemoryWindow, Messenger, PeerState, Places, Processor, Region, layout,
};

use super::{Post, ViewError};
use condor_rt::directory::{self, Directory, Kind};
use condor_rt::numbers::{PROCESSORS, VISITORS};

const NAME: &str = "wishes";
const MASK_WORDS: usize = VARIABLES / 32;
const WISH_BYTES: u32 = 4 * (1 + MASK_WORDS as u32);
const BYTES: u32 = 4 + WISH_BYTES * PROCESSORS as u32;
/// The first word of a request for a selection, in a block of a monitor.
const SELECT: u32 = 1;

/// The wishes of a visitor.
#[derive(Clone, Debug)]
pub(super) struct Wishes {
    me: Processor,
    region: Region<LinuxWindow>,
    offset: u32,
}

impl Wishes {
    /// None, in the window of `post`, whose directory is the first of `places` and has nothing else.
    pub(super) fn new(post: &Post, places: &mut Places) -> Result<Self, ViewError> {
        let me = post.number();
        let at = |source| ViewError::Memory {
            processor: me,
            source,
        };
        let region = Region::users(post.windows(me)?.data.clone()).map_err(at)?;
        let mut directory = Directory::new(region.clone(), places)?;
        let offset = places.bytes(BYTES as usize).map_err(at)?;
        let wishes = Self { me, region, offset };
        for number in 0..PROCESSORS as u8 {
            wishes.set(Processor(number), None).map_err(at)?;
        }
        directory.enter(NAME, Kind::Other, offset, BYTES)?;
        Ok(wishes)
    }

    /// Says what is watched of a processor; `life` is that of the visitor.
    pub(super) fn tell(
        &self,
        of: Processor,
        life: u32,
        wish: &Selection,
    ) -> Result<(), AccessError> {
        self.region.set_word(self.offset, life)?;
        self.set(of, Some(wish))
    }

    /// Nothing is watched of that processor any more.
    pub(super) fn withdraw(&self, of: Processor) -> Result<(), AccessError> {
        self.set(of, None)
    }

    fn set(&self, of: Processor, wish: Option<&Selection>) -> Result<(), AccessError> {
        let at = self.offset + 4 + WISH_BYTES * u32::from(of.0);
        // It is whole when its first word says that there is one.
        self.region.set_word(at, 0)?;
        let Some(wish) = wish else {
            return Ok(());
        };
        let mut mask = [0; MASK_WORDS];
        for variable in wish.variables() {
            if let Some(word) = mask.get_mut(variable / 32) {
                *word |= 1 << (variable % 32);
            }
        }
        for (offset, word) in (at + 4..).step_by(4).zip(mask) {
            self.region.set_word(offset, word)?;
        }
        self.region.set_word(at, wish.every())
    }

    /// What all others who live watch of the monitor of `of`, which lies at `places` in `monitor`.
    pub(super) fn of_others(
        &self,
        post: &Post,
        of: Processor,
        monitor: &Region<LinuxWindow>,
        places: MonitorPlaces,
    ) -> Result<Vec<Selection>, condor_mbox::Error> {
        let mut all = Vec::new();
        for number in (0..PROCESSORS as u8).map(Processor) {
            if number == self.me || number == of {
                continue;
            }
            let PeerState::Up { incarnation, .. } = post.peer_state(number)? else {
                continue;
            };
            let wish = if VISITORS.contains(&number.0) {
                let data = post.windows(number)?.data.clone();
                visitors(&data, incarnation, of)
            } else {
                programs(monitor, places, number)
            };
            // A window in which no wish can be has none.
            all.extend(wish.ok().flatten());
        }
        Ok(all)
    }
}

/// What a visitor says.
fn visitors(
    data: &LinuxWindow,
    life: u32,
    of: Processor,
) -> Result<Option<Selection>, AccessError> {
    let region = Region::users(data.clone())?;
    let Some(entry) = directory::find(&region, NAME)?.filter(|entry| entry.len == BYTES) else {
        return Ok(None);
    };
    let wishes = region.part(entry.offset, entry.len)?;
    if wishes.word(0)? != life {
        return Ok(None);
    }
    selection(&wishes, 4 + WISH_BYTES * u32::from(of.0))
}

/// What a program has asked the monitor for.
fn programs(
    monitor: &Region<LinuxWindow>,
    places: MonitorPlaces,
    number: Processor,
) -> Result<Option<Selection>, AccessError> {
    match places.block(number) {
        Some(block) if monitor.word(block)? == SELECT => selection(monitor, block + 4),
        _ => Ok(None),
    }
}

/// Every which tick, and the words of a selection.
fn selection(region: &Region<LinuxWindow>, at: u32) -> Result<Option<Selection>, AccessError> {
    let every = region.word(at)?;
    let mut variables = Vec::new();
    for (word, offset) in (0..MASK_WORDS).zip((at + 4..).step_by(4)) {
        let mask = region.word(offset)?;
        let bits = (0..32).filter(|bit| mask >> bit & 1 == 1);
        variables.extend(bits.map(|bit| 32 * word + bit));
    }
    if variables.is_empty() {
        return Ok(None);
    }
    Ok(Selection::new(variables, every).ok())
}

/// All of them, at a rate of which every rate is a multiple.
pub(super) fn together(wishes: &[Selection]) -> Selection {
    let every = wishes.iter().map(Selection::every).reduce(common);
    let variables = wishes.iter().flat_map(Selection::variables);
    // Each of them is a selection, so that all together are one.
    Selection::new(variables, every.unwrap_or(1)).unwrap_or(Selection::NOTHING)
}

/// The greatest common divisor; a selection has no 0.
const fn common(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// The life of a visitor; 0 before it has joined.
pub(super) fn life(post: &Post) -> Result<u32, condor_mbox::Error> {
    let mail = &post.windows(post.number())?.mail;
    // A visitor without memory of its own has no life.
    Ok(mail
        .load(layout::header::INCARNATION, LoadOrder::Acquire)
        .unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rates_have_a_rate_of_which_both_are_multiples() {
        assert_eq!([common(10, 4), common(1, 7), common(6, 6)], [2, 1, 6]);
    }

    #[test]
    fn wishes_together_have_all_variables() {
        let wish = |variables: &[usize], every| Selection::new(variables.to_vec(), every).unwrap();
        let both = together(&[wish(&[3, 40], 6), wish(&[7, 40], 4)]);
        assert_eq!(both, wish(&[3, 7, 40], 2));
        assert_eq!(together(&[]), Selection::NOTHING);
    }
}
