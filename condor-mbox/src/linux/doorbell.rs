//! [`LinuxDoorbell`]: a futex, and a pipe for programs that poll descriptors.
//!
//! The doorbell of a processor is the first line of its `data`. Word 0 counts rings; threads sleep on it as a
//! futex. Word 1 is not 0 if the processor also wants its rings to be readable from its pipe. Any program may
//! overwrite both words; then a wait ends early, or at its deadline.

use core::num::NonZeroU32;
use core::sync::atomic::{Ordering, fence};
use core::time::Duration;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd, RawFd};
use std::sync::Arc;

use rustix::io::Errno;
use rustix::thread::futex;
use rustix::time::{ClockId, Timespec, clock_gettime};

use super::lock;
use super::window::LinuxWindow;
use crate::doorbell::{Doorbell, Evidence};
use crate::id::Processor;
use crate::time::{Clock, Instant};

const RINGS: u32 = 0;
const ARMED: u32 = 4;

/// A drain reads no more than this many bytes, however fast a peer writes: the most that an
/// unprivileged process can make a pipe hold.
const DRAIN_BYTES: usize = 1 << 20;

/// Rings the processors of a [`LinuxSystem`](super::LinuxSystem), and waits for rings of its own number.
///
/// Its clock is `CLOCK_MONOTONIC`, so instants of all processes of a machine can be compared. All
/// clones are the same doorbell.
#[derive(Clone, Debug)]
pub struct LinuxDoorbell<const N: usize>(Arc<Bells<N>>);

#[derive(Debug)]
struct Bells<const N: usize> {
    number: Processor,
    /// The `data` of every processor.
    lines: [LinuxWindow; N],
    /// The files of every `mail`, opened for this alone: to ask for locks, one's own included.
    mails: [OwnedFd; N],
    pipes: [OwnedFd; N],
    own: PollableBell,
}

impl<const N: usize> LinuxDoorbell<N> {
    /// The doorbell of `number`, which `own_mail` holds; undoes what a former holder left.
    pub(super) fn new(
        number: Processor,
        own_mail: LinuxWindow,
        lines: [LinuxWindow; N],
        mails: [OwnedFd; N],
        pipes: [OwnedFd; N],
    ) -> std::io::Result<Self> {
        let pipe = pipes[number.index()].try_clone()?;
        let own = PollableBell {
            pipe: Arc::new(pipe),
            _holds: own_mail,
        };
        if let Ok(armed) = lines[number.index()].word(ARMED) {
            // Pairs with nothing: who rings between this and the drain makes a spurious wake-up.
            armed.store(0, Ordering::Relaxed);
        }
        own.drain();
        Ok(Self(Arc::new(Bells {
            number,
            lines,
            mails,
            pipes,
            own,
        })))
    }

    /// Returns the number of the processor whose rings end a wait for this doorbell.
    #[must_use]
    pub fn number(&self) -> Processor {
        self.0.number
    }

    /// Returns a descriptor that becomes readable when this processor is rung, for poll, epoll or
    /// an asynchronous runtime.
    ///
    /// From the first call until the number is claimed anew, each ring costs its sender a second
    /// system call.
    #[must_use]
    pub fn pollable(&self) -> PollableBell {
        if let Ok(armed) = self.0.lines[self.0.number.index()].word(ARMED) {
            armed.store(1, Ordering::Relaxed);
            // Pairs with the fence in `ring`: either the ringer sees the word, or who looks for
            // messages after this sees what the ringer published.
            fence(Ordering::SeqCst);
        }
        self.0.own.clone()
    }
}

impl<const N: usize> Clock for LinuxDoorbell<N> {
    #[allow(
        clippy::useless_conversion,
        reason = "tv_nsec has 32 bits on some targets"
    )]
    #[inline]
    fn now(&self) -> Instant {
        let time = clock_gettime(ClockId::Monotonic);
        // Since the machine started: neither negative nor near 584 years.
        let ns = time
            .tv_sec
            .wrapping_mul(1_000_000_000)
            .wrapping_add(i64::from(time.tv_nsec));
        Instant::from_ns(ns.cast_unsigned())
    }
}

impl<const N: usize> Doorbell for LinuxDoorbell<N> {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        let Some(bell) = self.0.lines.get(processor.index()) else {
            return;
        };
        let (Ok(rings), Ok(armed)) = (bell.word(RINGS), bell.word(ARMED)) else {
            return;
        };
        // Pairs with the Acquire load in `prepare`: who has seen this ring sees the message.
        rings.fetch_add(1, Ordering::Release);
        // Pairs with the fence in `pollable`.
        fence(Ordering::SeqCst);
        let polled = armed.load(Ordering::Relaxed) != 0;
        // Errors mean that the memory is gone, which the mailbox finds out by itself.
        let _ = futex::wake(rings, futex::Flags::empty(), i32::MAX as u32);
        if polled {
            // A full pipe is readable already.
            let _ = rustix::io::write(&self.0.pipes[processor.index()], &[1; 8]);
        }
    }

    fn prepare(&self) -> u32 {
        let rings = self.0.lines[self.0.number.index()].word(RINGS);
        // Pairs with the Release addition in `ring`.
        rings.map_or(0, |rings| rings.load(Ordering::Acquire))
    }

    fn wait(&self, seen: u32, until: Instant, _: Option<Processor>) {
        let Ok(rings) = self.0.lines[self.0.number.index()].word(RINGS) else {
            return;
        };
        // Any number of nanoseconds that fits 64 bits has a `Timespec`.
        let until = Timespec::try_from(Duration::from_nanos(until.as_ns())).ok();
        // The kernel compares and sleeps in one step. Rung already, interrupted, too late, or
        // memory gone: the caller looks again in each case.
        let _ = futex::wait_bitset(
            rings,
            futex::Flags::empty(),
            seen,
            until.as_ref(),
            NonZeroU32::MAX,
        );
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        if processor == self.0.number {
            return Evidence::Alive;
        }
        match self.0.mails.get(processor.index()).map(lock::is_held) {
            Some(Ok(true)) => Evidence::Alive,
            Some(Ok(false)) => Evidence::Dead,
            Some(Err(_)) | None => Evidence::Unknown,
        }
    }
}

/// A descriptor that is readable when a processor has been rung.
///
/// Drain it first, then look for messages, then poll: a ring after the drain makes it readable again. Only one
/// thread should poll it; if several do, one may drain the ring of another. All clones are the same descriptor,
/// which stays open until the last of them is dropped.
///
/// The descriptor is the reading end of a pipe, so tokio's `pipe::Receiver` takes a duplicate of it; see the
/// example `await_tokio`. Call [`Mailbox::ring_always`](crate::Mailbox::ring_always), so that peers ring
/// although nothing waits inside the mailbox.
#[derive(Clone, Debug)]
pub struct PollableBell {
    pipe: Arc<OwnedFd>,
    _holds: LinuxWindow,
}

impl PollableBell {
    /// Empties the pipe without blocking, so that it is readable again only after the next ring.
    ///
    /// Returns false if it is still readable, because peers ring as fast as it is drained. A
    /// program that waits for *changes* of readiness, as edge-triggered epoll does, must then drain
    /// again.
    #[must_use = "an edge-triggered poller must drain again if it is false"]
    pub fn try_drain(&self) -> bool {
        let mut sink = [0; 4096];
        for _ in 0..DRAIN_BYTES / sink.len() {
            match rustix::io::read(&self.pipe, &mut sink) {
                Ok(0) | Err(Errno::AGAIN) => return true,
                Ok(_) | Err(Errno::INTR) => {}
                Err(_) => return true,
            }
        }
        false
    }

    /// Empties the pipe as [`try_drain`](Self::try_drain) does. Use it for level-triggered polling,
    /// which returns at once if the pipe is still readable.
    pub fn drain(&self) {
        let _ = self.try_drain();
    }
}

impl AsFd for PollableBell {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.pipe.as_fd()
    }
}

impl AsRawFd for PollableBell {
    fn as_raw_fd(&self) -> RawFd {
        self.pipe.as_raw_fd()
    }
}
