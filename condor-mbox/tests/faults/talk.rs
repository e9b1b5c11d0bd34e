//! What the processors say to each other, so that every wrong word is noticed.

use std::time::Duration;

use condor_mbox::{Processor, Vector};

/// Two survivors, and the one that is killed.
pub(crate) const SURVIVORS: [Processor; 2] = [Processor(0), Processor(1)];
pub(crate) const VICTIM: Processor = Processor(2);
/// Processors of the system.
pub(crate) const N: usize = 3;

/// The victim's vectors. The data of all of them is the sender's running number.
pub(crate) const ECHO: Vector = Vector(1);
/// No reply; counted.
pub(crate) const COUNTED: Vector = Vector(2);
/// Asks the sender back before it replies.
pub(crate) const ASK_BACK: Vector = Vector(3);
/// Asks the other survivor before it replies.
pub(crate) const ASK_OTHER: Vector = Vector(4);
/// Does not return while the aim is the victim's handler.
pub(crate) const HOLD: Vector = Vector(5);

/// The survivors' vectors: a question of the victim.
pub(crate) const QUESTION: Vector = Vector(1);
/// A message of the victim without reply; see [`Numbered`].
pub(crate) const NUMBERED: Vector = Vector(2);

/// Longer than anything lasts that is not broken.
pub(crate) const LONG: Duration = Duration::from_secs(10);

/// Bit that says that a nested call of the victim failed.
const FAILED: u32 = 1 << 31;

/// What the victim replies in `incarnation` to `data` for `vector`; `nested` is what it was told meanwhile.
pub(crate) fn reply(vector: Vector, data: u32, nested: Option<u32>, incarnation: u32) -> u32 {
    let failed = if nested.is_none() { FAILED } else { 0 };
    mixed(u32::from(vector.0) << 24 ^ data ^ nested.unwrap_or(0).rotate_left(7))
        ^ failed
        ^ incarnation
}

/// The incarnation in which the victim gave `found`, if that is a reply to `data` for `vector` during
/// which it was told `nested`.
pub(crate) fn incarnation_of(found: u32, vector: Vector, data: u32, nested: u32) -> u32 {
    found ^ reply(vector, data, Some(nested), 0)
}

/// Whether `found` says that the nested call failed, and in which incarnation.
pub(crate) fn failed_in(found: u32, vector: Vector, data: u32) -> u32 {
    found ^ reply(vector, data, None, 0)
}

/// What a survivor answers to a [`QUESTION`].
pub(crate) fn answer(data: u32, survivor: Processor) -> u32 {
    mixed(data ^ u32::from(survivor.0 + 1) << 28)
}

fn mixed(word: u32) -> u32 {
    let word = (word ^ (word >> 16)).wrapping_mul(0x85EB_CA6B);
    let word = (word ^ (word >> 13)).wrapping_mul(0xC2B2_AE35);
    word ^ (word >> 16)
}

/// A message of the victim: the low bits of its incarnation, and its number in that incarnation from 1 on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Numbered {
    pub(crate) incarnation: u32,
    pub(crate) number: u32,
}

impl Numbered {
    const BITS: u32 = 12;
    const MASK: u32 = (1 << Self::BITS) - 1;
    /// Incarnations are told apart modulo this.
    const INCARNATIONS: u32 = 1 << (u32::BITS - Self::BITS);

    pub(crate) fn new(incarnation: u32, number: u32) -> Self {
        Self {
            incarnation: incarnation % Self::INCARNATIONS,
            number: number & Self::MASK,
        }
    }

    pub(crate) fn word(self) -> u32 {
        self.incarnation << Self::BITS | self.number
    }

    pub(crate) fn of(word: u32) -> Self {
        Self {
            incarnation: word >> Self::BITS,
            number: word & Self::MASK,
        }
    }

    /// Whether `self` may be the next that arrives after `former`.
    pub(crate) fn may_follow(self, former: Self) -> bool {
        if self.incarnation == former.incarnation {
            self.number == former.number.wrapping_add(1) & Self::MASK
        } else {
            let later = self.incarnation.wrapping_sub(former.incarnation) % Self::INCARNATIONS;
            self.number == 1 && later < Self::INCARNATIONS / 2
        }
    }
}
