//! The floor: two words, one cache line a direction, and nothing else.

#![allow(
    clippy::unnecessary_wraps,
    reason = "other contestants can fail to open"
)]

use std::hint::spin_loop;
use std::sync::atomic::{AtomicU32, Ordering};

use rustix::io::Errno;
use rustix::thread::futex;

use super::contestant::{Ends, Setup};
use crate::Result;

/// Opens the spinning ping-pong.
pub(super) fn open_spinning<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    let (client, server) = spinning(setup.words);
    Ok(Ends::new(move || Ok(client), move || Ok(server)))
}

/// Returns the two ends of the spinning ping-pong on two words that are zero: one that sends a value, which
/// differs from the one before, and waits for the answer; one that answers so many values.
pub(crate) fn spinning(
    words: [&AtomicU32; 2],
) -> (
    impl FnMut(u32) -> Result<u32> + '_,
    impl FnMut(u32) -> Result<()> + '_,
) {
    let wait = |_: &AtomicU32, _| {
        spin_loop();
        Ok(())
    };
    ping_pong(words, |_| Ok(()), wait)
}

/// Opens the ping-pong that sleeps on the published word itself, and wakes unconditionally.
pub(super) fn open_futex<'m>(setup: &Setup<'m>) -> Result<Ends<'m>> {
    let wake = |word: &AtomicU32| {
        futex::wake(word, futex::Flags::empty(), 1)?;
        Ok(())
    };
    let wait = |word: &AtomicU32, old| match futex::wait(word, futex::Flags::empty(), old, None) {
        Ok(()) | Err(Errno::AGAIN | Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    };
    let (client, server) = ping_pong(setup.words, wake, wait);
    Ok(Ends::new(move || Ok(client), move || Ok(server)))
}

/// Makes the two ends, by a function that wakes the other side, and one that waits while the word has its
/// old value.
fn ping_pong<'m>(
    [request, answer]: [&'m AtomicU32; 2],
    wake: impl Fn(&AtomicU32) -> Result<()> + Copy + 'm,
    wait: impl Fn(&AtomicU32, u32) -> Result<()> + Copy + 'm,
) -> (
    impl FnMut(u32) -> Result<u32> + 'm,
    impl FnMut(u32) -> Result<()> + 'm,
) {
    let publish = move |word: &AtomicU32, value| {
        // Pairs with the `Acquire` load in `await_change` of the other side.
        word.store(value, Ordering::Release);
        wake(word)
    };
    let await_change = move |word: &AtomicU32, old| -> Result<u32> {
        loop {
            // Pairs with the `Release` store in `publish` of the other side.
            let value = word.load(Ordering::Acquire);
            if value != old {
                return Ok(value);
            }
            wait(word, old)?;
        }
    };
    // The value of the other side's word that either side has seen last.
    let (mut answered, mut requested) = (0, 0);
    let client = move |value| {
        publish(request, value)?;
        answered = await_change(answer, answered)?;
        Ok(answered)
    };
    let server = move |count| {
        for _ in 0..count {
            requested = await_change(request, requested)?;
            publish(answer, requested)?;
        }
        Ok(())
    };
    (client, server)
}
