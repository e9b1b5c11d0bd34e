//! [`Entry`], a contestant: one way to ask another process and get its answer.

use std::path::Path;
use std::sync::atomic::AtomicU32;

use super::samples::{Samples, Slice};
use crate::Result;
use crate::clock::ticks;

/// The cores on which the two processes run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cores {
    /// Client and server each have a core.
    Two,
    /// Both share the client's core: whoever waits has to sleep.
    One,
}

/// A contestant and how to build it.
pub(super) struct Entry {
    /// The name of the contestant in the table.
    pub(super) name: &'static str,
    /// The cores on which it runs.
    pub(super) cores: Cores,
    /// Builds it, before client and server are forked.
    pub(super) open: Open,
}

/// Builds a contestant.
pub(super) type Open = for<'m> fn(&Setup<'m>) -> Result<Ends<'m>>;

/// The means with which a contestant may be built.
pub(super) struct Setup<'m> {
    /// Words of the mapping of this round, on cache lines of their own.
    pub(super) words: [&'m AtomicU32; 2],
    /// A directory for its files, removed at the end.
    pub(super) directory: &'m Path,
    /// The beginning that its files outside of that directory must have; those are removed, too.
    pub(super) prefix: &'m str,
    /// A name that no other contestant has.
    pub(super) service: String,
}

/// Makes an end, in its process.
type Make<'m, E> = Box<dyn FnOnce() -> Result<Box<E>> + 'm>;

/// Both ends of a connection, before they are parted by a fork.
pub(super) struct Ends<'m> {
    /// The end that asks.
    pub(super) client: Make<'m, dyn Client + 'm>,
    /// The end that answers, which is made before the first client's.
    pub(super) server: Make<'m, Server<'m>>,
}

impl<'m> Ends<'m> {
    /// Makes the ends by two functions that are called in the processes of client and server. The client's
    /// returns a function that sends a value and waits for the answer; the server's returns one that
    /// answers as many requests as it is told, with the values that came.
    pub(super) fn new<C, S>(
        client: impl FnOnce() -> Result<C> + 'm,
        server: impl FnOnce() -> Result<S> + 'm,
    ) -> Self
    where
        C: FnMut(u32) -> Result<u32> + 'm,
        S: FnMut(u32) -> Result<()> + 'm,
    {
        Self {
            client: Box::new(|| Ok(Box::new(client()?))),
            server: Box::new(|| Ok(Box::new(server()?))),
        }
    }
}

/// The end that answers as many requests as it is told, with the values that came.
pub(super) type Server<'m> = dyn FnMut(u32) -> Result<()> + 'm;

/// The end that asks: a function that sends a value, which differs from the one before and is not zero, and
/// waits for the answer.
///
/// No client waits for ever: a process that still waits when the time of its round is up is killed.
pub(super) trait Client {
    /// Makes the round trips of a slice, and checks every answer.
    ///
    /// Half of them are timed in batches, of which the table shows the median: a timestamp would cost a
    /// good part of a round trip. The other half is timed one by one, of which the table shows the 99th
    /// percentile.
    fn play(&mut self, slice: &Slice, values: &mut Values, samples: &mut Samples) -> Result<()>;
}

impl<F: FnMut(u32) -> Result<u32>> Client for F {
    fn play(&mut self, slice: &Slice, values: &mut Values, samples: &mut Samples) -> Result<()> {
        for _ in 0..slice.warm_up {
            values.check(&mut *self)?;
        }
        for _ in 0..slice.batches {
            let begin = ticks();
            for _ in 0..slice.batch {
                values.check(&mut *self)?;
            }
            let passed = ticks().wrapping_sub(begin);
            samples.add_batch(passed, slice.batch);
        }
        let mut begin = ticks();
        for _ in 0..slice.single {
            values.check(&mut *self)?;
            let end = ticks();
            samples.add_single(end.wrapping_sub(begin));
            begin = end;
        }
        Ok(())
    }
}

/// The values that a client sends.
#[derive(Default)]
pub(super) struct Values(u32);

impl Values {
    /// Makes one call with the next value.
    #[inline]
    fn check(&mut self, call: impl FnOnce(u32) -> Result<u32>) -> Result<()> {
        self.0 = self.0.wrapping_add(1).max(1);
        let answer = call(self.0)?;
        if answer == self.0 {
            Ok(())
        } else {
            Err(wrong_answer(self.0, answer))
        }
    }
}

#[cold]
fn wrong_answer(sent: u32, got: u32) -> Box<dyn std::error::Error> {
    format!("sent {sent}, got {got}").into()
}
