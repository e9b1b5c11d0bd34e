//! Shared memory without messages: regions, published values, locks.

use condor_mbox::published::ReadError;
use condor_mbox::spin_lock::{Incarnations, LockError, Owner, TestAndSet};
use condor_mbox::window::{WindowErrorKind, check_access, check_words};
use condor_mbox::{
    AccessError, Backend, Clock, Doorbell, MemoryWindow, Messenger, Place, Places, Published,
    Region, SpinLock,
};

use crate::map::{MAP, Sample};
use crate::messages::served_until;
use crate::{Checks, FOLLOWER, Mbox, PATIENCE};

/// How often each of the two counts up under a lock.
const ROUNDS: u32 = 300;

/// What a lock is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockKind {
    /// Loads and stores.
    Bakery,
    /// A hardware semaphore.
    Semaphore,
    /// Compare-and-swap.
    Swap,
}

impl LockKind {
    const fn word(self) -> u32 {
        match self {
            Self::Bakery => 0x1_0000,
            Self::Semaphore => 0x2_0000,
            Self::Swap => 0x3_0000,
        }
    }

    const fn from_word(word: u32) -> Option<Self> {
        match word & 0xffff_0000 {
            0x1_0000 => Some(Self::Bakery),
            0x2_0000 => Some(Self::Semaphore),
            0x3_0000 => Some(Self::Swap),
            _ => None,
        }
    }
}

/// The locks that a machine has.
pub trait Locks<W> {
    /// Their kinds.
    const KINDS: &'static [LockKind];

    /// Lets `body` have the lock of this kind at offset `at`.
    ///
    /// # Errors
    /// As the constructor of the lock's memory.
    fn with_lock(
        &self,
        kind: LockKind,
        ram: Region<&W>,
        at: u32,
        body: &mut dyn FnMut(&dyn Locking),
    ) -> Result<(), AccessError>;
}

/// A [`SpinLock`] of any kind.
pub trait Locking {
    /// Runs `body` with the lock if it is free.
    ///
    /// # Errors
    /// As [`SpinLock::try_lock`].
    fn try_locked(
        &self,
        me: Owner,
        incarnations: &dyn Incarnations,
        body: &mut dyn FnMut(),
    ) -> Result<(), LockError>;

    /// Runs `body` with the lock.
    ///
    /// # Errors
    /// As [`SpinLock::lock`].
    fn locked(
        &self,
        me: Owner,
        incarnations: &dyn Incarnations,
        clock: &dyn Clock,
        body: &mut dyn FnMut(),
    ) -> Result<(), LockError>;

    /// Takes the lock and never releases it.
    ///
    /// # Errors
    /// As [`SpinLock::try_lock`].
    fn take_for_good(&self, me: Owner, incarnations: &dyn Incarnations) -> Result<(), LockError>;

    /// Takes the lock over from the dead.
    ///
    /// # Errors
    /// As [`SpinLock::recover`].
    fn recover(
        &self,
        dead: Owner,
        me: Owner,
        incarnations: &dyn Incarnations,
    ) -> Result<(), LockError>;
}

impl<L: TestAndSet> Locking for SpinLock<L> {
    fn try_locked(
        &self,
        me: Owner,
        incarnations: &dyn Incarnations,
        body: &mut dyn FnMut(),
    ) -> Result<(), LockError> {
        let guard = self.try_lock(me, incarnations)?;
        body();
        guard.release()
    }

    fn locked(
        &self,
        me: Owner,
        incarnations: &dyn Incarnations,
        clock: &dyn Clock,
        body: &mut dyn FnMut(),
    ) -> Result<(), LockError> {
        let guard = self.lock(me, incarnations, &clock, PATIENCE)?;
        body();
        drop(guard);
        Ok(())
    }

    fn take_for_good(&self, me: Owner, incarnations: &dyn Incarnations) -> Result<(), LockError> {
        self.try_lock(me, incarnations).map(core::mem::forget)
    }

    fn recover(
        &self,
        dead: Owner,
        me: Owner,
        incarnations: &dyn Incarnations,
    ) -> Result<(), LockError> {
        SpinLock::recover(self, dead, me, incarnations)?.release()
    }
}

/// Everybody lives.
struct Everybody;

impl Incarnations for Everybody {
    fn is_current(&self, _: Owner) -> bool {
        true
    }
}

/// The leader's checks of memory that it shares with a follower that takes its
/// [turns](crate::turn).
pub fn memory<B: Backend, L>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, B>, locks: &L)
where
    L: Locks<B::Window>,
{
    let Ok(ram) = mailbox.region(FOLLOWER) else {
        return checks.that("the follower has memory", false);
    };
    regions(checks, &ram);
    published(checks, mailbox, &ram);
    for &kind in L::KINDS {
        match kind {
            LockKind::Bakery => checks.group(" a lock of loads and stores"),
            LockKind::Semaphore => checks.group(" a lock beside a hardware semaphore"),
            LockKind::Swap => checks.group(" a lock of compare-and-swap"),
        }
        shared_count(checks, mailbox, &ram, locks, kind);
        let made = locks.with_lock(kind, ram, MAP.lock, &mut |lock| {
            dead_owner(checks, mailbox, lock);
        });
        checks.same("the lock has its memory", made, Ok(()));
    }
}

fn regions<W: MemoryWindow + Clone>(checks: &mut Checks<'_>, ram: &Region<W>) {
    let mut bytes = [0; 6];
    let copied = ram
        .write(MAP.words, b"condor")
        .and_then(|()| ram.read(MAP.words, &mut bytes));
    checks.same("bytes are copied", copied, Ok(()));
    checks.same("in and out", &bytes, b"condor");
    let part = ram.part(MAP.words, 8);
    checks.that(
        "a part of a region begins at its own zero",
        part.and_then(|part| part.word(0)) == ram.word(MAP.words),
    );
    let whole = Region::whole(ram.clone());
    checks.same("a window can be a region", whole.size(), ram.size());
    let place = Place::<[u32; 3]>::at(ram.size());
    checks.same(
        "a place outside is refused",
        ram.get(place).err().map(|error| error.kind),
        Some(WindowErrorKind::OutOfBounds),
    );
    checks.same(
        "so is a word outside",
        check_words(ram.size(), ram.size(), 1),
        Err(WindowErrorKind::OutOfBounds),
    );
    checks.same(
        "and what is misaligned",
        check_access(ram.size(), 2, 4),
        Err(WindowErrorKind::Misaligned),
    );
    let mut places = Places::new(ram.size());
    let two = (places.bytes(8), places.place::<u64>());
    checks.that(
        "places are laid out one after another",
        matches!(two, (Ok(first), Ok(second)) if second.offset() > first),
    );
}

fn published<B: Backend>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, B>, ram: &Region<&B::Window>) {
    let Ok(subscriber) = MAP.sample.subscriber(*ram) else {
        return checks.that("a subscriber finds the cell", false);
    };
    let subscriber = subscriber.with_attempts(8);
    let again = Published::<Sample>::at(MAP.sample.offset()).subscriber(*ram);
    checks.that("a cell is found by its offset, too", again.is_ok());
    let (mut last, mut seen, mut whole) = (0, 0_u32, true);
    let changed = served_until(mailbox, || {
        match subscriber.read() {
            Ok(latest) => {
                let [first, rest @ ..] = latest.value;
                whole &= rest.iter().all(|word| *word == first);
                if latest.sequence != last {
                    last = latest.sequence;
                    seen += 1;
                }
            }
            Err(ReadError::Unpublished | ReadError::Contended { .. }) => {}
            Err(_) => whole = false,
        }
        seen >= 20
    });
    checks.that("published values are polled", changed);
    checks.that("each is whole", whole);
}

/// Both count up the same two words, under the lock.
fn shared_count<B: Backend, L>(
    checks: &mut Checks<'_>,
    mailbox: &Mbox<'_, B>,
    ram: &Region<&B::Window>,
    locks: &L,
    kind: LockKind,
) where
    L: Locks<B::Window>,
{
    let Ok(me) = mailbox.owner() else {
        return checks.that("the leader has joined", false);
    };
    let begun = ram
        .set(Place::at(MAP.counted), &[0_u32; 2])
        .and_then(|()| ram.set_word(MAP.to_count, kind.word() | ROUNDS));
    checks.same("counting begins", begun, Ok(()));
    let mut right = true;
    let mut taken = 0;
    let made = locks.with_lock(kind, *ram, MAP.lock, &mut |lock| {
        for _ in 0..ROUNDS {
            let clock: &dyn Clock = &Now(mailbox.doorbell());
            let locked = lock.locked(me, mailbox, clock, &mut || {
                right &= matches!(count_up(ram), Ok(true));
            });
            taken += u32::from(locked.is_ok());
        }
    });
    checks.same("the lock has its memory", made, Ok(()));
    checks.same("the leader gets it each time", taken, ROUNDS);
    let done = served_until(mailbox, || {
        ram.word(MAP.to_count).is_ok_and(|word| word == kind.word())
    });
    checks.that("the follower gets it, too", done);
    checks.that("nobody saw the structure half changed", right);
    checks.same(
        "no count was lost",
        ram.get(Place::at(MAP.counted)),
        Ok([2 * ROUNDS; 2]),
    );
}

/// The follower's part: never waits for the lock.
pub(crate) fn count_some<B: Backend, L>(mailbox: &Mbox<'_, B>, locks: &L) -> Result<(), AccessError>
where
    L: Locks<B::Window>,
{
    let (Ok(ram), Ok(me)) = (mailbox.region(mailbox.number()), mailbox.owner()) else {
        return Ok(());
    };
    let word = ram.word(MAP.to_count)?;
    let Some(kind) = LockKind::from_word(word) else {
        return Ok(());
    };
    let mut left = word & 0xffff;
    locks.with_lock(kind, ram, MAP.lock, &mut |lock| {
        for _ in 0..left.min(16) {
            let mut right = false;
            let locked = lock.try_locked(me, mailbox, &mut || {
                right = matches!(count_up(&ram), Ok(true));
            });
            // What was not right is never counted, and the leader waits in vain.
            left -= u32::from(locked.is_ok() && right);
        }
    })?;
    if left == word & 0xffff {
        return Ok(());
    }
    ram.set_word(MAP.to_count, kind.word() | left)
}

/// Counts both words up; whether they were equal.
fn count_up<W: MemoryWindow>(ram: &Region<W>) -> Result<bool, AccessError> {
    let place = Place::<[u32; 2]>::at(MAP.counted);
    let [first, second] = ram.get(place)?;
    ram.set_word(MAP.counted, first.wrapping_add(1))?;
    ram.set_word(MAP.counted.wrapping_add(4), second.wrapping_add(1))?;
    Ok(first == second)
}

fn dead_owner<B: Backend>(checks: &mut Checks<'_>, mailbox: &Mbox<'_, B>, lock: &dyn Locking) {
    let (Ok(me), Ok(dead)) = (mailbox.owner(), Owner::new(FOLLOWER, 0xdead)) else {
        return checks.that("the leader has joined", false);
    };
    checks.same(
        "a life that is over takes no lock",
        lock.try_locked(dead, mailbox, &mut || {}),
        Err(LockError::NotCurrent { owner: dead }),
    );
    checks.same(
        "somebody dies with the lock",
        lock.take_for_good(dead, &Everybody),
        Ok(()),
    );
    checks.same(
        "the next one is told",
        lock.try_locked(me, mailbox, &mut || {}),
        Err(LockError::OwnerDead { owner: dead }),
    );
    checks.same("and recovers it", lock.recover(dead, me, mailbox), Ok(()));
    checks.same(
        "it is free again",
        lock.try_locked(me, mailbox, &mut || {}),
        Ok(()),
    );
}

/// The clock of a doorbell.
struct Now<'d, D>(&'d D);

impl<D: Doorbell> Clock for Now<'_, D> {
    fn now(&self) -> condor_mbox::Instant {
        self.0.now()
    }
}
