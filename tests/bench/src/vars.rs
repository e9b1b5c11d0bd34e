//! `vars`: rows of 2 500 variables beside a plain copy of the same bytes.

use std::hint::black_box;
use std::sync::atomic::Ordering;

use condor_mbox::linux::{LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, CriticalSection, Instant, MemoryWindow as _, Processor};
use condor_vars::{
    Catalog, Sampler, Scalar as _, Selections, Var, VariableSettings, VariableTable, Vars, Watch,
};
use fastrand::Rng;

use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::measure::{Goal, Report, quantile};
use crate::options::Options;
use crate::process::{CorePair, pin};
use crate::rounds::{self, NS, Tables};

const HEAD: &str = "2 500 variables of 64 bits";
/// The ways that are compared.
const WAYS: [&str; 5] = [
    "memcpy into a ring of as many rows",
    "  the same once more (control)",
    "condor-vars: 25 blocks of 100",
    "condor-vars: 2 500 single variables",
    "  an array of these in a bare loop (the least)",
];

const COUNT: usize = 2500;
const BLOCK: usize = 100;
const BLOCKS: usize = COUNT / BLOCK;
/// Rows of each ring: 320 KB.
const ROWS: usize = 16;
/// Times that each is done in a round.
const TICKS: usize = 300;
/// Room for the table and the ring.
const BYTES: u32 = 640_000;

type Loop<const SOURCES: usize> = Sampler<'static, LinuxWindow, SOURCES>;

/// Runs the sub-command.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(31, 9);
    pin(CorePair::find()?.first)?;
    let mut tables = Tables::new(NS);
    tables.rows(HEAD, &WAYS);
    tables.fill(play(rounds)?);
    let text = format!(
        "{rounds} rounds; medians over the rounds of one tick's time, and of ratios of times in the same\n\
         round, with the interval that holds the true median in 95 of 100 runs.\n{tables}",
    );
    let to_memcpy = |way: usize| tables.ratio(&[(HEAD, WAYS[way], 0)], &[(HEAD, WAYS[0], 0)]);
    let goals = vec![
        Goal::most("blocks_vs_memcpy", to_memcpy(2)?, 2.0),
        Goal::most("singles_vs_memcpy", to_memcpy(3)?, 4.0),
    ];
    Ok(Report { text, goals })
}

/// Plays rounds, in memory of Linux that processes share; returns the nanoseconds of a tick by each way.
fn play(rounds: usize) -> Result<Vec<Vec<f64>>> {
    let blocks = (0..BLOCKS).map(|_| Vars::<f64, BLOCK>::numbered("block", "rad"));
    let singles = (0..COUNT).map(|_| Var::<f64>::new("single", "rad"));
    let array: &'static [Var<f64>] = Vec::leak(singles.collect());
    let mut blocks = begin::<_, BLOCKS>(Vec::leak(blocks.collect()))?;
    let mut singles = begin::<_, COUNT>(array)?;
    let from = vec![0; COUNT * f64::KIND.words()];
    let mut peers = [(); 2].map(|()| Plain::new(from.len()));
    let mut least = Plain::new(from.len());
    let calibration = Calibration::begin();
    rounds::play(rounds, |round| {
        let mut samples: [Vec<f64>; WAYS.len()] = [const { Vec::new() }; WAYS.len()];
        let mut order = Rng::with_seed(round as u64);
        let mut ways = [0, 1, 2, 3, 4];
        for tick in 0..TICKS as u64 {
            order.shuffle(&mut ways);
            for way in ways {
                let began = ticks();
                match way {
                    2 => sample(&mut blocks, tick)?,
                    3 => sample(&mut singles, tick)?,
                    4 => least.put(|to| bare(to, black_box(array))),
                    way => peers[way].put(|to| to.copy_from_slice(black_box(&from))),
                }
                samples[way].push(ticks().wrapping_sub(began) as f64);
            }
        }
        let ns = calibration.ns_per_tick();
        let medians = samples.iter_mut().map(|ticks| quantile(ticks, 0.5) * ns);
        Ok(medians.collect())
    })
}

/// A ring of plain memory.
struct Plain {
    ring: Vec<Vec<u32>>,
    place: usize,
}

impl Plain {
    fn new(words: usize) -> Self {
        Self {
            ring: vec![vec![0; words]; ROWS],
            place: 0,
        }
    }

    fn put(&mut self, copy: impl FnOnce(&mut [u32])) {
        self.place = (self.place + 1) % ROWS;
        copy(&mut self.ring[self.place]);
        black_box(&mut self.ring);
    }
}

/// Copies an array of variables: all that a row of them takes, if nothing had to be looked up.
fn bare(to: &mut [u32], singles: &[Var<f64>]) {
    for (to, single) in to.chunks_exact_mut(f64::KIND.words()).zip(singles) {
        for (to, word) in to.iter_mut().zip(single.words()) {
            *to = word.load(Ordering::Relaxed);
        }
    }
}

fn sample<const SOURCES: usize>(sampler: &mut Loop<SOURCES>, tick: u64) -> Result<()> {
    let sampler = black_box(sampler);
    sampler.begin()?;
    Ok(sampler.end(tick, Instant::from_ns(tick))?)
}

/// Makes a loop with a watcher that has selected everything.
fn begin<V: Watch, const SOURCES: usize>(variables: &'static [V]) -> Result<Loop<SOURCES>> {
    let shown: Vec<&'static dyn Watch> = variables.iter().map(|it| it as _).collect();
    let catalog = Catalog::new(Vec::leak(shown), &[]);
    let region = LinuxSystem::<1>::family(BYTES)?
        .claim(Processor(0))?
        .region(Processor(0))?;
    let selections = Box::leak(Box::new(Selections::new()));
    let settings = VariableSettings {
        rate: (1000, 1),
        rows: ROWS as u32,
        watchers: 1,
    };
    let (server, mut sampler) = selections.open(
        catalog,
        &region,
        &mut Allocator::new(region.size()),
        &settings,
        CriticalSection,
        &|_| 1,
    )?;
    let table = VariableTable::open(&region, 0)?;
    let all: Vec<u32> = (0..table.len()).collect();
    server.watch(&table, Processor(0), &all, 1)?;
    sampler.begin()?;
    Ok(sampler)
}
