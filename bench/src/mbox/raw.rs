//! The floor: two words, one cache line a direction, and nothing else.

#![allow(
    clippy::unnecessary_wraps,
    reason = "other contestants can fail to open"
)]

use std::hint::spin_loop;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::io::Errno;
use rustix::thread::futex;

use super::contestant::{Client, Contestant, Server, Setup};
use crate::Result;

/// Opens the spinning ping-pong.
pub(super) fn open_spinning<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(PingPong::<Spin>::new(setup)))
}

/// Opens the sleeping ping-pong.
pub(super) fn open_futex<'m>(setup: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(PingPong::<Futex>::new(setup)))
}

/// A request word and an answer word.
struct PingPong<'m, W> {
    request: &'m AtomicU32,
    answer: &'m AtomicU32,
    /// What this side has seen last of the other side's word.
    seen: u32,
    way: W,
}

impl<'m, W: Default> PingPong<'m, W> {
    fn new(setup: &Setup<'m>) -> Self {
        // Two lines apart, since processors fetch lines in pairs.
        Self {
            request: setup.place.line(0),
            answer: setup.place.line(2),
            seen: 0,
            way: W::default(),
        }
    }
}

/// How to tell the other side, and how to wait for it.
trait Way: Default {
    fn publish(&self, word: &AtomicU32, value: u32) -> Result<()>;
    fn await_change(&self, word: &AtomicU32, old: u32) -> Result<u32>;
}

#[derive(Default)]
struct Spin;

impl Way for Spin {
    #[inline]
    fn publish(&self, word: &AtomicU32, value: u32) -> Result<()> {
        // Pairs with the `Acquire` load in `await_change` of the other side.
        word.store(value, Ordering::Release);
        Ok(())
    }

    #[inline]
    fn await_change(&self, word: &AtomicU32, old: u32) -> Result<u32> {
        loop {
            // Pairs with the `Release` store in `publish` of the other side.
            let value = word.load(Ordering::Acquire);
            if value != old {
                return Ok(value);
            }
            spin_loop();
        }
    }
}

/// Sleeps on the published word itself, and wakes unconditionally.
#[derive(Default)]
struct Futex;

impl Way for Futex {
    #[inline]
    fn publish(&self, word: &AtomicU32, value: u32) -> Result<()> {
        // Pairs with the `Acquire` load in `await_change` of the other side.
        word.store(value, Ordering::Release);
        futex::wake(word, futex::Flags::empty(), 1)?;
        Ok(())
    }

    #[inline]
    fn await_change(&self, word: &AtomicU32, old: u32) -> Result<u32> {
        loop {
            // Pairs with the `Release` store in `publish` of the other side.
            let value = word.load(Ordering::Acquire);
            if value != old {
                return Ok(value);
            }
            match futex::wait(word, futex::Flags::empty(), old, None) {
                Ok(()) | Err(Errno::AGAIN | Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }
}

impl<W: Way> Contestant for PingPong<'_, W> {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        Ok(self)
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        Ok(self)
    }
}

impl<W: Way> Client for PingPong<'_, W> {
    #[inline]
    fn call(&mut self, value: u32) -> Result<u32> {
        self.way.publish(self.request, value)?;
        self.seen = self.way.await_change(self.answer, self.seen)?;
        Ok(self.seen)
    }
}

impl<W: Way> Server for PingPong<'_, W> {
    fn serve(&mut self, count: u32) -> Result<()> {
        for _ in 0..count {
            self.seen = self.way.await_change(self.request, self.seen)?;
            self.way.publish(self.answer, self.seen)?;
        }
        Ok(())
    }
}
