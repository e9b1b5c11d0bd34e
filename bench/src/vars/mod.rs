//! `vars`: rows of 2 500 variables beside a plain copy of the same bytes, and the instructions of a loop
//! that sets variables while nobody watches.

mod paths;
mod rows;

use std::fmt::Write as _;

use crate::Result;
use crate::callgrind;
use crate::measure::{Better, Estimate, Goal, Report};
use crate::options::Options;
use crate::process::{CorePair, pin};

pub(crate) use paths::go;

/// Runs the sub-command.
///
/// # Errors
/// valgrind is missing or fails.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let rounds = options.rounds.unwrap_or(if options.quick { 9 } else { 31 });
    pin(CorePair::find()?.first)?;
    let mut text = format!(
        "{rounds} rounds; medians over the rounds of one tick's time, and of ratios of times in the same\n\
         round, with the interval that holds the true median in 95 of 100 runs.\n",
    );
    let mut goals = Vec::new();
    let narrow = rows::play::<f32>(rounds)?;
    table(&mut text, "2 500 variables of 32 bits", &narrow)?;
    let wide = rows::play::<f64>(rounds)?;
    table(&mut text, "2 500 variables of 64 bits", &wide)?;
    for (name, way, limit) in [("blocks_vs_memcpy", 2, 2.0), ("singles_vs_memcpy", 3, 4.0)] {
        goals.push(Goal {
            name,
            estimate: Estimate::of(wide.iter().map(|round| round[way] / round[0])),
            limit,
            better: Better::Lower,
        });
    }

    writeln!(
        text,
        "\n{:52} {:>12}",
        "a tick that nobody watches", "instructions"
    )?;
    let mut count = |path: &str, about: &str| -> Result<f64> {
        let count = callgrind::instructions(path)?;
        writeln!(text, "{about:52} {count:12.1}")?;
        Ok(count)
    };
    let idle = count("vars_idle", "begin and end, four slots")?;
    let narrow = count("vars_narrow", "  and 16 variables of 32 bits are set")?;
    let wide = count("vars_wide", "  and 16 variables of 64 bits are set")?;
    for (name, instructions, limit) in [
        ("set_32_bits", narrow - idle, 3.0),
        ("set_64_bits", wide - idle, 4.0),
    ] {
        goals.push(Goal {
            name,
            // One of them is the body's own: it loads the value.
            estimate: Estimate::of([instructions / paths::SET as f64 - 1.0]),
            limit,
            better: Better::Lower,
        });
    }
    Ok(Report {
        text,
        goals,
        ..Report::default()
    })
}

fn table(text: &mut String, head: &str, rounds: &[rows::Figures]) -> Result<()> {
    writeln!(text, "\n{head:52} {:>8}  x first row [95 %]", "ns")?;
    for (way, name) in rows::WAYS.iter().enumerate() {
        let of = |way: usize| rounds.iter().map(move |figures| figures[way]);
        let ratio = Estimate::ratio(of(way), of(0));
        let ns = Estimate::of(of(way)).value;
        writeln!(text, "{name:52} {ns:8.0}  {ratio}")?;
    }
    Ok(())
}
