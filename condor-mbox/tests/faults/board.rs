//! Words in shared memory by which the processes know of each other what happened.
//!
//! They are no part of what is tested: each has one writer at a time, and is read to judge errors.

use condor_mbox::layout::{BELL_BYTES, header};
use condor_mbox::linux::{Claim, LinuxWindow};
use condor_mbox::{Instant, LoadOrder, MemoryWindow, StoreOrder, Windows};

use super::talk::{N, VICTIM};

/// Bytes that the words and the samples of one processor take.
pub(crate) const USER_BYTES: u32 = 256 * 1024;

/// Words of the director, in the `data` of processor 0.
#[derive(Clone, Copy)]
pub(crate) enum Director {
    /// How many victims have been killed: counted just before.
    Kills,
    /// When the latest was killed; a time takes two words.
    KilledAt,
    /// The number of the present victim, from 1 on.
    Victim = 3,
    /// When it was started.
    SpawnedAt,
    /// What the victim should be doing, an [`Aim`].
    Aim = 6,
    /// Stops begun, stops in force, stops ended.
    Stopping,
    Stopped,
    Continued,
    /// How long a call may last, in milliseconds.
    Patience,
    /// Not 0 when the survivors shall end.
    Over,
}

/// Words of the victim, in its `data`.
#[derive(Clone, Copy)]
pub(crate) enum Victim {
    /// The latest victim that held its number.
    Claimed,
    /// The latest victim that was ready to serve.
    Ready,
    /// Beginnings of incarnations: begun and done.
    Begun,
    Done,
    /// The incarnation that was begun last.
    Incarnation,
    /// Ends of incarnations: begun, and followed by a new incarnation.
    Leaving,
    Left,
    /// The latest victim that was inside `HOLD`, in the midst of sending.
    Held,
    Sending,
    /// Wrong things that the victims saw.
    Faults,
    /// For each survivor: the incarnation in which, how many counted messages came, the first, the last.
    Counted,
}

/// Words of a survivor, in its `data`.
#[derive(Clone, Copy)]
pub(crate) enum Survivor {
    /// Kills that it noticed.
    Noticed,
    /// The latest victim that gave it a good reply.
    Good,
    /// The latest victim that asked it a question within a call.
    Nested,
    /// How many calls ended while a stop was in force, and the latest stop after which it got a
    /// good reply.
    Stalls,
    Again,
    Faults,
    /// Errors by kind, then samples.
    Record,
}

/// Where the victim is killed or stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Aim {
    Idle,
    Handler,
    Sending,
    Nested,
    Joining,
    /// Wherever it happens to be.
    Anywhere,
}

impl Aim {
    pub(crate) const ALL: [Self; 6] = [
        Self::Idle,
        Self::Handler,
        Self::Sending,
        Self::Nested,
        Self::Joining,
        Self::Anywhere,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Handler => "in a handler",
            Self::Sending => "in mid-send",
            Self::Nested => "in a nested call",
            Self::Joining => "while joining",
            Self::Anywhere => "anywhere",
        }
    }
}

/// All words of all processors.
#[derive(Clone)]
pub(crate) struct Board {
    windows: [Windows<LinuxWindow>; N],
}

impl Board {
    pub(crate) fn new(claim: &Claim<N>) -> Self {
        Self {
            windows: claim.windows().clone(),
        }
    }

    /// The word number `index` of `processor`; sealed memory has all of them.
    pub(crate) fn word(&self, processor: usize, index: usize) -> u32 {
        let at = BELL_BYTES + 4 * index as u32;
        self.windows[processor]
            .data
            .load(at, LoadOrder::Acquire)
            .expect("the memory is sealed")
    }

    pub(crate) fn set_word(&self, processor: usize, index: usize, value: u32) {
        let at = BELL_BYTES + 4 * index as u32;
        self.windows[processor]
            .data
            .store(at, value, StoreOrder::Release)
            .expect("the memory is sealed");
    }

    pub(crate) fn director(&self, word: Director) -> u32 {
        self.word(0, word as usize)
    }

    pub(crate) fn direct(&self, word: Director, value: u32) {
        self.set_word(0, word as usize, value);
    }

    pub(crate) fn direct_time(&self, word: Director, at: Instant) {
        self.set_word(0, word as usize, at.as_ns() as u32);
        self.set_word(0, word as usize + 1, (at.as_ns() >> 32) as u32);
    }

    pub(crate) fn time(&self, word: Director) -> Instant {
        let high = u64::from(self.word(0, word as usize + 1));
        Instant::from_ns(high << 32 | u64::from(self.director(word)))
    }

    pub(crate) fn aim(&self) -> Aim {
        Aim::ALL[self.director(Director::Aim) as usize]
    }

    pub(crate) fn victim(&self, word: Victim) -> u32 {
        self.word(VICTIM.index(), word as usize)
    }

    pub(crate) fn set_victim(&self, word: Victim, value: u32) {
        self.set_word(VICTIM.index(), word as usize, value);
    }

    /// Word `index` of four that the victim keeps for `survivor`.
    pub(crate) fn counted(&self, survivor: usize, index: usize) -> u32 {
        self.word(
            VICTIM.index(),
            Victim::Counted as usize + 4 * survivor + index,
        )
    }

    pub(crate) fn set_counted(&self, survivor: usize, index: usize, value: u32) {
        self.set_word(
            VICTIM.index(),
            Victim::Counted as usize + 4 * survivor + index,
            value,
        );
    }

    // The survivors' words stand behind the director's, who is a survivor itself.
    const SURVIVOR: usize = 64;

    pub(crate) fn survivor(&self, survivor: usize, word: Survivor) -> u32 {
        self.word(survivor, Self::SURVIVOR + word as usize)
    }

    pub(crate) fn set_survivor(&self, survivor: usize, word: Survivor, value: u32) {
        self.set_word(survivor, Self::SURVIVOR + word as usize, value);
    }

    pub(crate) fn record(&self, survivor: usize, index: usize) -> u32 {
        self.word(survivor, Self::SURVIVOR + Survivor::Record as usize + index)
    }

    pub(crate) fn set_record(&self, survivor: usize, index: usize, value: u32) {
        self.set_word(
            survivor,
            Self::SURVIVOR + Survivor::Record as usize + index,
            value,
        );
    }

    /// The latest incarnation that the victim's mailbox began.
    pub(crate) fn last_incarnation(&self) -> u32 {
        self.windows[VICTIM.index()]
            .mail
            .load(header::LAST_INCARNATION, LoadOrder::Acquire)
            .expect("the memory is sealed")
    }
}
