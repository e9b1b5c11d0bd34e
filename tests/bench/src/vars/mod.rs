//! `vars`: rows of 2 500 variables beside a plain copy of the same bytes, and the instructions of a loop
//! that sets variables while nobody watches.

mod paths;
mod rows;

use crate::Result;
use crate::callgrind;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::process::{CorePair, pin};
use crate::rounds::{NS, Tables};

pub(crate) use paths::go;

const WIDTHS: [&str; 2] = ["2 500 variables of 32 bits", "2 500 variables of 64 bits"];

/// Runs the sub-command.
///
/// # Errors
/// Returns an error if valgrind is missing or fails.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds(31, 9);
    pin(CorePair::find()?.first)?;
    let mut tables = Tables::new(NS);
    for head in WIDTHS {
        tables.rows(head, &rows::WAYS);
    }
    let (narrow, wide) = (rows::play::<f32>(rounds)?, rows::play::<f64>(rounds)?);
    tables.fill(
        narrow
            .iter()
            .zip(&wide)
            .map(|both| [*both.0, *both.1].concat())
            .collect(),
    );
    let mut text = format!(
        "{rounds} rounds; medians over the rounds of one tick's time, and of ratios of times in the same\n\
         round, with the interval that holds the true median in 95 of 100 runs.\n{tables}",
    );
    let [idle, narrow, wide] = callgrind::table(
        &mut text,
        "a tick that nobody watches",
        [
            ("vars_idle", "begin and end, four slots"),
            ("vars_narrow", "  and 16 variables of 32 bits are set"),
            ("vars_wide", "  and 16 variables of 64 bits are set"),
        ],
    )?;
    let to_memcpy = |way: usize| {
        let lane = |way: usize| (WIDTHS[1], rows::WAYS[way], 0);
        tables.ratio(&[lane(way)], &[lane(0)])
    };
    // One instruction is the body's own: it loads the value.
    let each = |all: f64| Estimate::exactly((all - idle) / paths::SET as f64 - 1.0);
    let goals = vec![
        Goal::most("blocks_vs_memcpy", to_memcpy(2)?, 2.0),
        Goal::most("singles_vs_memcpy", to_memcpy(3)?, 4.0),
        Goal::most("set_32_bits", each(narrow), 3.0),
        Goal::most("set_64_bits", each(wide), 4.0),
    ];
    Ok(Report { text, goals })
}
