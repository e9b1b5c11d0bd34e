//! The latest value of a loop for the background, and the other way round.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use checks::Checks;
use condor_mos::{Latest, LatestReader, LatestWriter, LoopId, Loops, Overrun, Platform, Scheduler};

use crate::{LOOPS, await_until};

/// A value that is handed over: one number, in each of the words.
type Words = [u32; 16];

/// The number of times that the background hands over, and the least number for the loop.
const ROUNDS: u32 = 2000;
const RUNS: u32 = 10;

/// Checks a cell in a `static`.
pub(crate) fn calls(checks: &mut Checks<'_>) {
    static CELL: Latest<u8> = Latest::new(5);
    let Some((mut writer, mut reader)) = CELL.split() else {
        return checks.that(false);
    };
    checks.that(CELL.split().is_none());
    checks.same(*reader.read(), 5);
    writer.write(7);
    checks.same(*reader.read(), 7);
}

/// Checks a loop that writes values for the background, and reads those that the background writes.
pub(crate) fn latest<P: Platform + Sync, const E: usize>(
    checks: &mut Checks<'_>,
    scheduler: &Scheduler<P, LOOPS, E>,
) {
    let mut up = Latest::new(words(0));
    // As for values that cannot be copied.
    let mut down = Latest::with_buffers(words(0), words(0), words(0));
    let (mut to_background, mut from_loop) = up.split_mut();
    let (mut to_loop, mut from_background) = down.split_mut();
    let (sent, got) = (AtomicU32::new(0), AtomicU32::new(0));
    let right = AtomicBool::new(true);
    let receive = |from: &mut LatestReader<'_, Words>, since: &AtomicU32| match take(
        from,
        since.load(Relaxed),
    ) {
        Some(number) => since.store(number, Relaxed),
        None => right.store(false, Relaxed),
    };
    let mut servo_loop = |_| {
        let number = sent.load(Relaxed).wrapping_add(1);
        send(&mut to_background, number);
        sent.store(number, Relaxed);
        receive(&mut from_background, &got);
    };
    let received = AtomicU32::new(0);
    scheduler.scope(|scope| {
        let assigned = scope.assign(LoopId(0), Overrun::Skip, &mut servo_loop);
        checks.same(assigned, Ok(()));
        checks.same(scheduler.start(), Ok(()));
        for number in 1..=ROUNDS {
            send(&mut to_loop, number);
            receive(&mut from_loop, &received);
        }
        let done = await_until(scheduler.platform(), || {
            receive(&mut from_loop, &received);
            received.load(Relaxed) >= RUNS && got.load(Relaxed) == ROUNDS
        });
        checks.that(done);
        scheduler.stop();
    });
    checks.that(right.load(Relaxed));
    // The cell outlives its ends.
    let (_, mut reader) = up.split_mut();
    let latest = take(&mut reader, received.load(Relaxed));
    checks.same(latest, Some(sent.load(Relaxed)));
}

fn words(number: u32) -> Words {
    [number; 16]
}

/// Changes the value in place, word by word: whoever interrupts must not see that.
fn send(to: &mut LatestWriter<'_, Words>, number: u32) {
    for word in to.buffer() {
        *word = core::hint::black_box(number);
    }
    to.publish();
}

/// Reads a value; returns its number if all words are equal and not older than `since`.
fn take(from: &mut LatestReader<'_, Words>, since: u32) -> Option<u32> {
    let fresh = from.is_fresh();
    let [number, others @ ..] = from.read();
    let newer = if fresh {
        *number > since
    } else {
        *number >= since
    };
    (newer && others.iter().all(|word| word == number)).then_some(*number)
}
