//! The functions whose instructions are counted: ticks that nobody watches.

use std::hint::black_box;
use std::sync::atomic::{AtomicU32, Ordering};

use condor_mbox::{
    Allocator, CriticalSection, Instant, MemoryWindow as _, Region, StaticMemory, StaticWindow,
};
use condor_vars::{Catalog, Sampler, Selections, Var, VariableSettings, Watch};

use crate::Result;

/// The number of variables that a tick sets.
pub(super) const SET: usize = 16;

type Loop = Sampler<'static, StaticWindow<'static>, SET>;

static NARROW: [Var<f32>; SET] = [const { Var::new("narrow", "rad") }; SET];
static WIDE: [Var<f64>; SET] = [const { Var::new("wide", "rad") }; SET];

/// One after the other, as the body of a loop sets its variables.
macro_rules! set {
    ($variables:ident, $values:ident, $($index:literal)*) => {
        $($variables[$index].set($values[$index]);)*
    };
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_vars_idle(sampler: &mut Loop, tick: u64) -> bool {
    sampler.begin().is_ok() && sampler.end(tick, Instant::from_ns(tick)).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_vars_narrow(
    sampler: &mut Loop,
    tick: u64,
    values: &[f32; SET],
) -> bool {
    let begun = sampler.begin().is_ok();
    set!(NARROW, values, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
    begun && sampler.end(tick, Instant::from_ns(tick)).is_ok()
}

#[unsafe(no_mangle)]
#[inline(never)]
extern "Rust" fn condor_path_vars_wide(sampler: &mut Loop, tick: u64, values: &[f64; SET]) -> bool {
    let begun = sampler.begin().is_ok();
    set!(WIDE, values, 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15);
    begun && sampler.end(tick, Instant::from_ns(tick)).is_ok()
}

/// A tick by one of the paths; whether it went well.
type Path = Box<dyn FnMut(&mut Loop, u64) -> bool>;

/// Goes down a path so many times; `None` if there is none of this name.
pub(crate) fn go(name: &str, calls: usize) -> Option<Result<()>> {
    let mut path: Path = match name {
        "vars_idle" => Box::new(condor_path_vars_idle),
        "vars_narrow" => Box::new(|sampler, tick| {
            condor_path_vars_narrow(sampler, tick, black_box(&[tick as f32; SET]))
        }),
        "vars_wide" => Box::new(|sampler, tick| {
            condor_path_vars_wide(sampler, tick, black_box(&[tick as f64; SET]))
        }),
        _ => return None,
    };
    Some(begin().and_then(|mut sampler| {
        for tick in 0..calls as u64 {
            if !path(black_box(&mut sampler), black_box(tick)) {
                return Err(format!("tick {tick} failed").into());
            }
        }
        // The values that were set are there.
        let is_set = |words: &[AtomicU32]| words.iter().any(|it| it.load(Ordering::Relaxed) != 0);
        let expected = name != "vars_idle";
        if (is_set(NARROW[SET - 1].words()) || is_set(WIDE[SET - 1].words())) == expected {
            Ok(())
        } else {
            Err("the variables were not set".into())
        }
    }))
}

fn begin() -> Result<Loop> {
    static MEMORY: StaticMemory<16_384> = StaticMemory::new();
    let watched: Vec<&'static dyn Watch> = if black_box(true) {
        NARROW.iter().map(|it| it as _).collect()
    } else {
        WIDE.iter().map(|it| it as _).collect()
    };
    let catalog = Catalog::new(Vec::leak(watched), &[]);
    let region = Region::whole(MEMORY.window());
    let selections = Box::leak(Box::new(Selections::new()));
    let settings = VariableSettings {
        rate: (1000, 1),
        rows: 8,
        watchers: 4,
    };
    let mut allocator = Allocator::new(region.size());
    let lives = &|_| 1;
    let (_, sampler) = selections.open(
        catalog,
        &region,
        &mut allocator,
        &settings,
        CriticalSection,
        lives,
    )?;
    Ok(sampler)
}
