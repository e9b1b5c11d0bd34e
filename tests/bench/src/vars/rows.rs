//! The time of a tick in which all variables become a row.

use std::hint::black_box;
use std::sync::atomic::Ordering;

use condor_mbox::linux::{LinuxSystem, LinuxWindow};
use condor_mbox::{Allocator, CriticalSection, Instant, MemoryWindow as _, Processor};
use condor_vars::{
    Catalog, Sampler, Scalar, Selections, Var, VariableSettings, VariableTable, Vars, Watch,
};
use fastrand::Rng;

use crate::Result;
use crate::clock::{Calibration, ticks};
use crate::measure::quantile;
use crate::rounds;

/// The ways that are compared.
pub(super) const WAYS: [&str; 5] = [
    "memcpy into a ring of as many rows",
    "  the same once more (control)",
    "condor-vars: 25 blocks of 100",
    "condor-vars: 2 500 single variables",
    "  an array of these in a bare loop (the least)",
];

/// Nanoseconds of a tick by each of the ways.
pub(super) type Figures = [f64; WAYS.len()];

const COUNT: usize = 2500;
const BLOCK: usize = 100;
const BLOCKS: usize = COUNT / BLOCK;
/// Rows of each ring: 160 or 320 KB.
const ROWS: usize = 16;
/// Times that each is done in a round.
const TICKS: usize = 300;
/// Room for the table and the ring of 2 500 variables of 64 bits.
const BYTES: u32 = 640_000;

type Loop<const SOURCES: usize> = Sampler<'static, LinuxWindow, SOURCES>;

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
fn bare<T: Scalar>(to: &mut [u32], singles: &[Var<T>]) {
    let words = T::KIND.words();
    for (to, single) in to.chunks_exact_mut(words).zip(singles) {
        for (to, word) in to.iter_mut().zip(single.words()) {
            *to = word.load(Ordering::Relaxed);
        }
    }
}

/// Plays rounds, in memory of Linux that processes share.
pub(super) fn play<T: Scalar>(rounds: usize) -> Result<Vec<Figures>> {
    let blocks: &'static [Vars<T, BLOCK>] = Vec::leak(
        (0..BLOCKS)
            .map(|_| Vars::numbered("block", "rad"))
            .collect(),
    );
    let singles: &'static [Var<T>] =
        Vec::leak((0..COUNT).map(|_| Var::new("single", "rad")).collect());
    let mut blocks = begin::<_, BLOCKS>(blocks)?;
    let array = singles;
    let mut singles = begin::<_, COUNT>(singles)?;
    let words = COUNT * T::KIND.words();
    let from = vec![0; words];
    let mut peers = [(); 2].map(|()| Plain::new(words));
    let mut least = Plain::new(words);
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
        Ok(samples.each_mut().map(|ticks| quantile(ticks, 0.5) * ns))
    })
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
