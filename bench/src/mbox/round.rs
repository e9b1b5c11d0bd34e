//! A round: one fresh mapping, one client, one server, and every contestant in short turns.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use rustix::io::Errno;
use rustix::process::Pid;
use rustix::thread::futex;

use super::contestant::{Client, Contestant, Cores, Entry, Server, Setup, Values};
use super::interruption;
use super::mapping::{LINE_WORDS, Mapping, Place};
use super::samples::{Samples, Slice};
use crate::Result;
use crate::clock::Calibration;
use crate::process::{Child, CorePair, pin, wait_for_all};
use crate::shuffle::Shuffle;

/// How long a round is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    /// Slices of every contestant.
    pub(super) slices: u32,
    /// Nanoseconds of either half of a slice.
    pub(super) half_ns: f64,
    /// The client's and the server's core.
    pub(super) cores: CorePair,
}

/// A round that takes longer has gone wrong.
const ROUND_LIMIT: Duration = Duration::from_secs(60);

/// The other process takes orders, or carries one out, within this time.
const ORDER_LIMIT: Duration = Duration::from_secs(20);

/// How often an interruption is tried.
const INTERRUPTIONS: u32 = 20;

/// What one contestant reached in one round, in nanoseconds.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Figures {
    /// Median of the round trips in batches.
    pub(super) median: f64,
    /// 99th percentile of single round trips.
    pub(super) p99: f64,
    /// The median after an interruption; 0 if there was none.
    pub(super) interrupted: f64,
}

/// Plays a round; gives the figures of every entry.
///
/// # Safety
/// The calling process must have one thread only, since it is forked.
pub(super) unsafe fn play(
    entries: &[Entry],
    plan: &Plan,
    number: usize,
    directory: &Path,
    prefix: &str,
) -> Result<Vec<Figures>> {
    let mapping = Mapping::new(entries.len() + 1)?;
    let desk = Desk::new(mapping.place(entries.len()));
    let open = |(index, entry): (usize, &Entry)| {
        let service = format!("round-{number}/contestant-{index}");
        let setup = Setup {
            place: mapping.place(index),
            directory,
            prefix,
            service,
        };
        (entry.open)(&setup).map_err(|error| format!("{}: {error}", entry.name).into())
    };
    let contestants = entries
        .iter()
        .enumerate()
        .map(open)
        .collect::<Result<Vec<_>>>()?;

    // Either process takes its copy of every contestant apart; this one only drops them.
    let mut contestants = Some(contestants);
    // SAFETY: one thread only, by this function's contract.
    let server = unsafe {
        Child::fork("server", || {
            serve(&desk, contestants.take().unwrap_or_default(), plan)
        })
    }?;
    let server_pid = server.pid();
    // SAFETY: as above.
    let client = unsafe {
        Child::fork("client", || {
            let contestants = contestants.take().unwrap_or_default();
            compete(&desk, entries, contestants, plan, number as u64, server_pid)
        })
    }?;
    wait_for_all(&mut [client, server], ROUND_LIMIT)?;
    Ok((0..entries.len())
        .map(|index| desk.figures(index))
        .collect())
}

/// Where the client leaves its orders for the server, and its results for the parent.
struct Desk<'m> {
    /// Counts orders; the server sleeps on it.
    ordered: &'m AtomicU32,
    /// Counts what the server has done; the client sleeps on it.
    done: &'m AtomicU32,
    /// The contestant of the order, or [`Desk::END`].
    contestant: &'m AtomicU32,
    /// The core where the server has to be.
    core: &'m AtomicU32,
    /// How many requests are to be answered.
    count: &'m AtomicU32,
    results: &'m [AtomicU32],
}

impl<'m> Desk<'m> {
    /// In place of a contestant: the server may go.
    const END: u32 = u32::MAX;

    fn new(place: Place<'m>) -> Self {
        Self {
            ordered: place.line(0),
            done: place.line(2),
            contestant: place.line(4),
            core: place.line(6),
            count: place.line(8),
            results: &place.words()[16 * LINE_WORDS..],
        }
    }

    /// Leaves an order.
    fn order(&self, contestant: u32, core: usize, count: u32) -> Result<()> {
        self.contestant.store(contestant, Ordering::Relaxed);
        self.core.store(u32::try_from(core)?, Ordering::Relaxed);
        self.count.store(count, Ordering::Relaxed);
        advance(self.ordered)
    }

    /// The three results of a contestant, two words each.
    fn cells(&self, index: usize) -> impl Iterator<Item = &[AtomicU32]> {
        self.results[index * 6..].chunks(2).take(3)
    }

    fn report(&self, index: usize, figures: &Figures) {
        for (cell, value) in
            self.cells(index)
                .zip([figures.median, figures.p99, figures.interrupted])
        {
            let bits = value.to_bits();
            // Read by the parent after it has seen the end of this process.
            cell[0].store(bits as u32, Ordering::Relaxed);
            cell[1].store((bits >> 32) as u32, Ordering::Relaxed);
        }
    }

    fn figures(&self, index: usize) -> Figures {
        let mut values = self.cells(index).map(|cell| {
            let [low, high] = [0, 1].map(|half| u64::from(cell[half].load(Ordering::Relaxed)));
            f64::from_bits(low | high << 32)
        });
        let mut next = || values.next().unwrap_or_default();
        Figures {
            median: next(),
            p99: next(),
            interrupted: next(),
        }
    }
}

/// Counts one more, and wakes who waits for it.
fn advance(word: &AtomicU32) -> Result<()> {
    // Pairs with the `Acquire` load in `await_advance`.
    word.fetch_add(1, Ordering::Release);
    futex::wake(word, futex::Flags::empty(), 1)?;
    Ok(())
}

/// Sleeps until `word` has been counted on from `old`.
fn await_advance(word: &AtomicU32, old: u32) -> Result<()> {
    let deadline = Instant::now() + ORDER_LIMIT;
    // Pairs with the `Release` in `advance`.
    while word.load(Ordering::Acquire) == old {
        let left = deadline.saturating_duration_since(Instant::now());
        let timeout = futex::Timespec::try_from(left)?;
        match futex::wait(word, futex::Flags::empty(), old, Some(&timeout)) {
            Ok(()) | Err(Errno::AGAIN | Errno::INTR) => {}
            Err(error) => return Err(format!("the other process is silent: {error}").into()),
        }
    }
    Ok(())
}

/// The server's process: carries out orders until the last.
fn serve(desk: &Desk<'_>, contestants: Vec<Box<dyn Contestant + '_>>, plan: &Plan) -> Result<()> {
    pin(plan.cores.second)?;
    let servers = contestants.into_iter().map(Contestant::server);
    let mut servers: Vec<Box<dyn Server>> = servers.collect::<Result<_>>()?;
    advance(desk.done)?;
    for order in 0.. {
        await_advance(desk.ordered, order)?;
        let contestant = desk.contestant.load(Ordering::Relaxed);
        if contestant == Desk::END {
            break;
        }
        pin(desk.core.load(Ordering::Relaxed) as usize)?;
        let count = desk.count.load(Ordering::Relaxed);
        advance(desk.done)?;
        servers
            .get_mut(contestant as usize)
            .ok_or("an order for nobody")?
            .serve(count)?;
        advance(desk.done)?;
    }
    Ok(())
}

/// A contestant in the client's process.
struct Turn<'a> {
    index: usize,
    entry: &'a Entry,
    client: Box<dyn Client + 'a>,
    values: Values,
    samples: Samples,
    slice: Slice,
}

impl Turn<'_> {
    /// The round trips of `slice`; the server is ready for them.
    fn run(&mut self, slice: &Slice) -> Result<()> {
        self.client
            .play(slice, &mut self.values, &mut self.samples)
            .map_err(|error| format!("{}: {error}", self.entry.name).into())
    }
}

/// The client's process: gives every contestant its slices, in an order that changes.
fn compete<'a>(
    desk: &Desk<'_>,
    entries: &'a [Entry],
    contestants: Vec<Box<dyn Contestant + 'a>>,
    plan: &Plan,
    seed: u64,
    server: Pid,
) -> Result<()> {
    pin(plan.cores.first)?;
    let calibration = Calibration::begin();
    await_advance(desk.done, 0)?;
    let mut turns = Vec::new();
    for ((index, entry), contestant) in entries.iter().enumerate().zip(contestants) {
        let client = contestant
            .client()
            .map_err(|error| format!("{}: {error}", entry.name))?;
        let (values, samples) = (Values::default(), Samples::default());
        turns.push(Turn {
            index,
            entry,
            client,
            values,
            samples,
            slice: Slice::TRIAL,
        });
    }
    let mut referee = Referee {
        desk,
        cores: plan.cores,
        done: 1,
    };

    for turn in &mut turns {
        referee.play(turn)?;
        let call_ns = turn.samples.median() * calibration.ns_per_tick();
        turn.slice = Slice::lasting(plan.half_ns, call_ns);
        turn.samples = Samples::default();
    }
    let mut order = Shuffle(seed);
    for _ in 0..plan.slices {
        order.shuffle(&mut turns);
        for turn in &mut turns {
            referee.play(turn)?;
        }
    }
    for turn in &mut turns {
        let ns = calibration.ns_per_tick();
        let mut figures = Figures {
            median: turn.samples.median() * ns,
            p99: turn.samples.p99() * ns,
            interrupted: 0.0,
        };
        if turn.entry.interrupted {
            referee.interrupt(turn, server)?;
            figures.interrupted = turn.samples.median() * ns;
        }
        desk.report(turn.index, &figures);
    }
    desk.order(Desk::END, plan.cores.second, 0)
}

/// Brings client and server of a contestant together.
struct Referee<'a> {
    desk: &'a Desk<'a>,
    cores: CorePair,
    /// What the server has done so far.
    done: u32,
}

impl Referee<'_> {
    /// Calls `run` while the server answers so many requests.
    fn meet<T>(
        &mut self,
        turn: &mut Turn<'_>,
        count: u32,
        run: impl FnOnce(&mut Turn<'_>) -> Result<T>,
    ) -> Result<T> {
        let core = match turn.entry.cores {
            Cores::Two => self.cores.second,
            Cores::One => self.cores.first,
        };
        self.desk.order(u32::try_from(turn.index)?, core, count)?;
        await_advance(self.desk.done, self.done)?;
        let result = run(turn)?;
        await_advance(self.desk.done, self.done + 1)?;
        self.done += 2;
        Ok(result)
    }

    /// Plays one slice.
    fn play(&mut self, turn: &mut Turn<'_>) -> Result<()> {
        let slice = turn.slice;
        self.meet(turn, slice.round_trips(), |turn| turn.run(&slice))
    }

    /// Stops the server in a call, pauses, and plays one slice without a warm-up.
    fn interrupt(&mut self, turn: &mut Turn<'_>, server: Pid) -> Result<()> {
        let one = Slice::ONE;
        // The client itself may have been stopped until the server went on.
        for _ in 0..INTERRUPTIONS {
            let took = self.meet(turn, one.round_trips(), |turn| {
                interruption::of_server(server, || turn.run(&one))
            })?;
            if took < interruption::GONE / 2 {
                continue;
            }
            interruption::of_client();
            turn.samples = Samples::default();
            turn.slice.warm_up = 1;
            return self.play(turn);
        }
        Err(format!("{}: no call met a stopped server", turn.entry.name).into())
    }
}
