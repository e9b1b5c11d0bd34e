//! The calls that this program does not make, which the search for paths that panic must see all the same.

use core::fmt::Display as _;
use core::hint::black_box;

use condor_mbox::exchange::{Blocks, Exchange, answer};
use condor_mbox::published::{Publisher, Subscriber};
#[cfg(target_has_atomic = "32")]
use condor_mbox::spin_lock::NativeSwap;
use condor_mbox::spin_lock::{
    Bakery, HardwareSemaphore, LockOwner, SemaphoreSwap, SpinLockGuard, TestAndSet,
};
use condor_mbox::{
    Call, CriticalSection, MailboxError, MemoryWindow, MessageTicket, Messenger, Region, SpinLock,
    VectorStatistics,
};
use firmware::keep;

use crate::map::{MAP, Sample};
use crate::{Mail, PROCESSORS, Window};

type Users = Region<&'static Window>;
type Answered = Blocks<Sample, u32>;

pub(crate) fn kept(mailbox: &Mail<'_>) {
    black_box(mailbox as &dyn Messenger);
    if let Ok(ram) = mailbox.region(mailbox.number()) {
        black_box(&ram as &dyn MemoryWindow<Error = _>);
        locks(ram);
    }
    black_box(answered as *const ());
    keep! {
        Mail: join, leave, declare_stopped, windows, peer_state, region, owner, set_listener,
            listen, listens_to, missed, beat, set_vector, clear_vector, vector_statistics, set_waiting, ring_always,
            wait_for_peer;
        VectorStatistics: name;
        Call<'_>: send, send_with_reply, begin, serve, refuse;
        MessageTicket<'_>: attach, detach, wait, poll;
        MailboxError: fmt;
        Users: users, whole, part, word, set_word, get::<Sample>, set::<Sample>;
        Exchange<'_, Mail<'_>, Users, Sample, u32>: new, call;
        Answered: new, block, client::<Mail<'_>, &Window>;
        Publisher<Sample, Users>: publish;
        Subscriber<Sample, Users>: read;
        SpinLock<&dyn TestAndSet>: try_lock, recover;
        SpinLockGuard<'_, &dyn TestAndSet>: release;
        LockOwner: new;
    }
}

fn answered(call: &Call<'_>, own: &Users) -> u32 {
    let sum = |terms: Sample| {
        terms
            .iter()
            .fold(0, |sum: u32, term| sum.wrapping_add(*term))
    };
    answer(call, own, sum).wrapping_add(Answered::at(0, 2).answer(call, own, sum))
}

/// Keeps the kinds of locks.
fn locks(ram: Region<&Window>) {
    let lock = MAP.lock;
    let bakery = Bakery::new(ram, lock, PROCESSORS as u8, CriticalSection);
    black_box(bakery.ok().as_ref().map(|it| it as &dyn TestAndSet));
    let semaphore = SemaphoreSwap::new(ram, lock, Semaphore, CriticalSection);
    black_box(semaphore.ok().as_ref().map(|it| it as &dyn TestAndSet));
    #[cfg(target_has_atomic = "32")]
    black_box(
        NativeSwap::new(ram, lock)
            .ok()
            .as_ref()
            .map(|it| it as &dyn TestAndSet),
    );
}

/// No machine here has a semaphore in hardware.
struct Semaphore;

impl HardwareSemaphore for Semaphore {
    fn try_take(&self) -> bool {
        black_box(true)
    }

    fn give(&self) {
        black_box(());
    }
}
