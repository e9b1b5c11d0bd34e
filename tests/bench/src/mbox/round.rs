//! A round: one fresh mapping, one client, one server, and every contestant in short turns.

use std::cell::Cell;
use std::path::Path;
use std::time::Duration;

use fastrand::Rng;

use super::contestant::{Client, Cores, Ends, Entry, Setup, Values};
use super::mapping::Mapping;
use super::samples::{Samples, Slice};
use crate::Result;
use crate::clock::Calibration;
use crate::process::{self, CorePair, Orders, pin};

/// The length of a round, and its cores.
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

/// Cache lines of a contestant's words and the lines between: processors fetch lines in pairs.
const LINES: usize = 4;

/// Plays a round; returns the medians and 99th percentiles of all entries in nanoseconds.
///
/// # Safety
/// The calling process must have one thread only, since it is forked.
pub(super) unsafe fn play(
    entries: &[Entry],
    plan: &Plan,
    number: usize,
    directory: &Path,
    prefix: &str,
) -> Result<Vec<f64>> {
    let mapping = Mapping::new(LINES * entries.len())?;
    let open = |(index, entry): (usize, &Entry)| {
        let service = format!("round-{number}/contestant-{index}");
        let setup = Setup {
            words: [0, 2].map(|line| mapping.line(LINES * index + line)),
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
    let contestants = Cell::new(contestants);
    // SAFETY: one thread only, by this function's contract.
    unsafe {
        process::part(
            plan.cores,
            ROUND_LIMIT,
            |orders| serve(orders, contestants.take()),
            |orders| compete(orders, entries, contestants.take(), plan, number as u64),
        )
    }
}

/// The value in place of a contestant after which the server may go.
const END: u32 = u32::MAX;

/// Runs the server's process: carries out orders until the last. An order is a contestant, the core where it has to
/// be, and the number of requests to answer; the server says when it is ready, and when it has answered them.
fn serve(orders: &Orders, contestants: Vec<Ends<'_>>) -> Result<()> {
    let servers = contestants
        .into_iter()
        .map(|contestant| (contestant.server)());
    let mut servers = servers.collect::<Result<Vec<_>>>()?;
    orders.say()?;
    loop {
        let [contestant, core, count] = orders.take()?;
        if contestant == END {
            return Ok(());
        }
        pin(core as usize)?;
        orders.say()?;
        let server = servers.get_mut(contestant as usize);
        server.ok_or("an order for nobody")?(count)?;
        orders.say()?;
    }
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

/// Runs the client's process: every contestant has its slices, in an order that changes.
fn compete<'a>(
    orders: &Orders,
    entries: &'a [Entry],
    contestants: Vec<Ends<'a>>,
    plan: &Plan,
    seed: u64,
) -> Result<Vec<f64>> {
    let calibration = Calibration::begin();
    orders.hear()?;
    let mut turns = Vec::new();
    for ((index, entry), contestant) in entries.iter().enumerate().zip(contestants) {
        let client = (contestant.client)().map_err(|error| format!("{}: {error}", entry.name))?;
        turns.push(Turn {
            index,
            entry,
            client,
            values: Values::default(),
            samples: Samples::default(),
            slice: Slice::TRIAL,
        });
    }
    let referee = Referee {
        orders,
        cores: plan.cores,
    };

    for turn in &mut turns {
        referee.play(turn)?;
        let call_ns = turn.samples.median() * calibration.ns_per_tick();
        turn.slice = Slice::lasting(plan.half_ns, call_ns);
        turn.samples = Samples::default();
    }
    let mut order = Rng::with_seed(seed);
    for _ in 0..plan.slices {
        order.shuffle(&mut turns);
        for turn in &mut turns {
            referee.play(turn)?;
        }
    }
    turns.sort_by_key(|turn| turn.index);
    let mut figures = Vec::new();
    for turn in &mut turns {
        figures.extend([turn.samples.median(), turn.samples.p99()]);
    }
    orders.send([END, 0, 0])?;
    let ns = calibration.ns_per_tick();
    Ok(figures.iter().map(|ticks| ticks * ns).collect())
}

/// Brings client and server of a contestant together.
struct Referee<'a> {
    orders: &'a Orders,
    cores: CorePair,
}

impl Referee<'_> {
    /// Plays one slice, for which the server is where the contestant wants it.
    fn play(&self, turn: &mut Turn<'_>) -> Result<()> {
        let core = match turn.entry.cores {
            Cores::Two => self.cores.second,
            Cores::One => self.cores.first,
        };
        let count = turn.slice.round_trips();
        self.orders
            .send([u32::try_from(turn.index)?, u32::try_from(core)?, count])?;
        self.orders.hear()?;
        turn.client
            .play(&turn.slice, &mut turn.values, &mut turn.samples)
            .map_err(|error| format!("{}: {error}", turn.entry.name))?;
        self.orders.hear()
    }
}
