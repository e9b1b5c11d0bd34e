//! [`Contestant`]: one way to ask another process and get its answer.

use std::path::Path;

use super::mapping::Place;
use super::samples::{Samples, Slice};
use crate::Result;
use crate::clock::ticks;

/// Where the two processes run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cores {
    /// Client and server each have a core.
    Two,
    /// Both share the client's core: whoever waits has to sleep.
    One,
}

/// A contestant and how to build it.
pub(super) struct Entry {
    /// What the table calls it.
    pub(super) name: &'static str,
    /// Where it runs.
    pub(super) cores: Cores,
    /// Whether it is measured once more after a preemption of the server and a pause.
    pub(super) interrupted: bool,
    /// Builds it, before client and server are forked.
    pub(super) open: Open,
}

/// Builds a contestant.
pub(super) type Open = for<'m> fn(&Setup<'m>) -> Result<Box<dyn Contestant + 'm>>;

/// What a contestant may build on.
pub(super) struct Setup<'m> {
    /// Its part of the mapping of this round.
    pub(super) place: Place<'m>,
    /// A directory for its files, removed at the end.
    pub(super) directory: &'m Path,
    /// How its files outside of that directory must begin; those are removed, too.
    pub(super) prefix: &'m str,
    /// A name that no other contestant has.
    pub(super) service: String,
}

/// Both ends of a connection, before they are parted by a fork.
pub(super) trait Contestant {
    /// Becomes the client's end, in the client's process.
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a;

    /// Becomes the server's end, in the server's process.
    ///
    /// Every server's end exists before the first client's end.
    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a;
}

/// The end that asks.
///
/// Nobody waits for ever: whoever still waits when the time of its round is up is killed.
pub(super) trait Client {
    /// Sends `value`, which differs from the one before and is not zero, and waits for the answer.
    fn call(&mut self, value: u32) -> Result<u32>;

    /// Makes the round trips of a slice, and checks every answer.
    ///
    /// Half of them are timed in batches, of which the table shows the median: a time stamp
    /// would cost a good part of a round trip. The other half is timed one by one, of which the
    /// table shows the 99th percentile.
    fn play(&mut self, slice: &Slice, values: &mut Values, samples: &mut Samples) -> Result<()> {
        for _ in 0..slice.warm_up {
            values.check(|value| self.call(value))?;
        }
        for _ in 0..slice.batches {
            let begin = ticks();
            for _ in 0..slice.batch {
                values.check(|value| self.call(value))?;
            }
            let passed = ticks().wrapping_sub(begin);
            samples.add_batch(passed, slice.batch);
        }
        let mut begin = ticks();
        for _ in 0..slice.single {
            values.check(|value| self.call(value))?;
            let end = ticks();
            samples.add_single(end.wrapping_sub(begin));
            begin = end;
        }
        Ok(())
    }
}

/// The end that answers.
pub(super) trait Server {
    /// Answers so many requests with the value that came.
    fn serve(&mut self, count: u32) -> Result<()>;
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
