//! `mos-instructions`: what a release costs on a Cortex-M3, in instructions.
//!
//! Three loops at 400, 100 and 50 Hz run for some seconds of virtual time under
//! `qemu-system-arm -icount`, as firmwares of `tests/bench/firmware` that differ in the scheduler alone.
//! How instructions are counted is told in `tests/bench/firmware/board/src/lib.rs`. The counts are
//! exact and the same every time, so there are no rounds and the intervals have no width.

mod figures;
mod firmware;

use std::fmt::Write as _;

use figures::{Alarm, Figures, Lines, check};
use firmware::Workspace;

use crate::Result;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;

/// The names of the schedulers, and their packages in `tests/bench/firmware`.
const CONTESTANTS: [(&str, &str); 3] = [
    ("condor-mos", "condor-loops-plain"),
    ("with counts", "condor-loops"),
    ("RTIC 2", "rtic-loops"),
];

/// Builds and runs all firmwares, the calibration first.
///
/// # Errors
/// Returns an error if a tool is missing, if a firmware does not build or end, or if the calibration is
/// off.
pub(crate) fn run(_: &Options) -> Result<Report> {
    let workspace = Workspace::build()?;
    let calibration = Lines::parse(&workspace.run("calibration")?)?;
    let checked = check(&calibration)?;
    let alarm = Alarm::of(&calibration)?;
    let mut text = format!(
        "calibration: {checked}\n\n{:14} {:>12} {:>12} {:>10} {:>10}\n",
        "instructions", "per release", "with body", "to body", "releases"
    );
    let mut row = |(name, package)| -> Result<Figures> {
        let lines = Lines::parse(&workspace.run(package)?)?;
        let figures = Figures::of(&lines, alarm)?;
        writeln!(
            text,
            "{name:14} {:12.2} {:12.2} {:10.1} {:10}",
            figures.per_release, figures.with_body, figures.to_body, figures.releases
        )?;
        Ok(figures)
    };
    let [ours, counted, rtic] = CONTESTANTS.map(&mut row);
    let goals = goals(ours?, counted?, rtic?);
    Ok(Report { text, goals })
}

fn goals(ours: Figures, counted: Figures, rtic: Figures) -> Vec<Goal> {
    let goal = |name, value, limit| Goal::most(name, Estimate::exactly(value), limit);
    vec![
        goal("to_body", ours.to_body, 45.0),
        goal("per_release", ours.per_release, 62.0),
        goal("per_release_with_counts", counted.per_release, 85.0),
        goal(
            "per_release_vs_rtic",
            ours.per_release / rtic.per_release,
            0.25,
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_compare_with_rtic_of_the_same_run() {
        let figures = |per_release, to_body| Figures {
            per_release,
            with_body: per_release + 9.0,
            to_body,
            releases: 550,
        };
        let (ours, counted) = (figures(60.0, 46.0), figures(80.0, 60.0));
        let goals = goals(ours, counted, figures(240.0, 148.0));
        let values = goals.iter().map(|goal| goal.estimate.value);
        assert!(values.eq([46.0, 60.0, 80.0, 0.25]));
        let verdicts = goals.iter().map(Goal::verdict);
        assert!(verdicts.eq([
            crate::measure::Verdict::Short,
            crate::measure::Verdict::Met,
            crate::measure::Verdict::Met,
            crate::measure::Verdict::Met
        ]));
    }
}
