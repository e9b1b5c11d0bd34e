//! Counts of processors: read by commands and the user interface, shown in the same tables.

use std::collections::HashMap;

use serde::Serialize;

use crate::table::{Left, Right, TextTable, or_dash};
use condor_host::control::Member;
use condor_host::description::ProcessorEntry;
use condor_host::plain::plain;
use condor_host::view::{
    BoardInterrupts, LoopRates, LoopSample, Percentiles, VectorCounts, View, ViewError,
};

/// The counts of a loop or a vector, and the processor or service that has it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row<C> {
    pub(crate) processor: String,
    #[serde(flatten)]
    pub(crate) counts: C,
}

impl<C> Row<C> {
    pub(crate) fn all(
        member: &Member,
        counts: impl IntoIterator<Item = C>,
    ) -> impl Iterator<Item = Self> {
        counts.into_iter().map(|counts| Self {
            processor: member.name.clone(),
            counts,
        })
    }
}

/// The counts of the last look, by the numbers of processors.
#[derive(Default)]
pub(crate) struct LastLook(HashMap<u8, LoopSample>);

impl LastLook {
    /// Returns what the loops of processors did since the last look.
    pub(crate) fn since(
        &mut self,
        view: &View,
        members: &[Member],
    ) -> Result<Vec<Row<LoopRates>>, ViewError> {
        let mut rows = Vec::new();
        for member in members {
            let sample = view.loops(member.processor())?;
            let rates = sample.since(self.0.get(&member.number));
            rows.extend(Row::all(member, rates));
            self.0.insert(member.number, sample);
        }
        Ok(rows)
    }
}

/// Returns the counts of the vectors of processors and services.
pub(crate) fn vectors<'m>(
    view: &View,
    members: impl IntoIterator<Item = &'m Member>,
) -> Result<Vec<Row<VectorCounts>>, ViewError> {
    let mut rows = Vec::new();
    for member in members {
        rows.extend(Row::all(member, view.vectors(member.processor())?));
    }
    Ok(rows)
}

/// Returns the counts of the interrupts of those processors whose boards interrupt.
pub(crate) fn interrupts(
    view: &View,
    members: &[Member],
) -> Result<Vec<Row<BoardInterrupts>>, ViewError> {
    let mut rows = Vec::new();
    for member in members {
        rows.extend(Row::all(member, view.interrupts(member.processor())?));
    }
    Ok(rows)
}

/// Returns a table that begins with an empty line, or nothing if no board interrupts.
pub(crate) fn table_of_interrupts(rows: &[Row<BoardInterrupts>]) -> String {
    let mut table = TextTable::new([
        ("processor", Left),
        ("interrupts", Right),
        ("unclaimed", Right),
        ("unhandled", Right),
        ("stuck", Right),
        ("spurious", Right),
        ("vectors", Left),
    ]);
    for Row { processor, counts } in rows {
        table.row([
            processor.clone(),
            counts.served.to_string(),
            counts.unclaimed.to_string(),
            counts.unhandled.to_string(),
            counts.stuck.to_string(),
            counts.spurious.to_string(),
            named_vectors(counts),
        ]);
    }
    if rows.is_empty() {
        String::new()
    } else {
        format!("\n{table}")
    }
}

/// Names what interrupted although it should not have.
fn named_vectors(counts: &BoardInterrupts) -> String {
    let list = |what: &str, numbers: Vec<String>| {
        (!numbers.is_empty()).then(|| format!("{what} {}", numbers.join(", ")))
    };
    let texts = |numbers: &[u16]| numbers.iter().map(u16::to_string).collect();
    let causes = counts.unhandled_causes.iter().map(u8::to_string).collect();
    let named = [
        list("without a driver:", texts(&counts.unhandled_vectors)),
        list("stuck:", texts(&counts.stuck_vectors)),
        list("traps:", causes),
    ];
    named.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

pub(crate) fn table_of_loops(rows: &[Row<LoopRates>]) -> TextTable<9> {
    let mut table = TextTable::new([
        ("processor", Left),
        ("loop", Left),
        ("Hz", Right),
        ("reached", Right),
        ("run µs", Right),
        ("worst", Right),
        ("use %", Right),
        ("late µs", Right),
        ("overruns", Right),
    ]);
    for Row { processor, counts } in rows {
        let state = if counts.faulted {
            " (faulted)"
        } else if counts.enabled {
            ""
        } else {
            " (disabled)"
        };
        // Without times nothing delays a loop; where others have some, it is late by those.
        let lateness = Some(counts.worst_lateness_us);
        let lateness = lateness.filter(|us| *us > 0.0 || counts.run_us.is_some());
        table.row([
            processor.clone(),
            format!("{}{state}", counts.name),
            counts.rate_hz.to_string(),
            or_dash(counts.reached_hz.map(tenths)),
            or_dash(counts.run_us.map(tenths)),
            or_dash(counts.worst_run_us.map(tenths)),
            or_dash(
                counts
                    .utilisation
                    .map(|part| format!("{:.2}", 100.0 * part)),
            ),
            or_dash(lateness.map(tenths)),
            counts.overruns.to_string(),
        ]);
    }
    table
}

/// The lines under a table of loops: the meaning of dashes, if simulated time is the reason for some of them, and the
/// processors whose loops have no event table.
pub(crate) fn note_of_loops(rows: &[Row<LoopRates>]) -> String {
    let has_dashes = rows.iter().any(|row| row.counts.run_us.is_none());
    let dashes = "Simulated time: loops take the time of `loop_times_us`; without it, none (-).\n";
    let computed = rows.iter().filter(|row| row.counts.computed);
    let mut computed: Vec<_> = computed.map(|row| &*row.processor).collect();
    computed.dedup();
    let names = computed.join(", ");
    let without_table = format!(
        "{}: no event table has room for these rates, so each release takes longer; choose rounder rates.\n",
        plain(&names)
    );
    let notes = [
        has_dashes.then_some(dashes),
        (!names.is_empty()).then_some(&*without_table),
    ];
    notes.into_iter().flatten().collect()
}

/// Returns a table of the percentiles of lateness and run times, after an empty line.
pub(crate) fn table_of_percentiles(rows: &[Row<LoopRates>]) -> String {
    let mut table = TextTable::new([
        ("processor", Left),
        ("loop", Left),
        ("time", Left),
        ("50 % µs", Right),
        ("99 %", Right),
        ("99.9 %", Right),
        ("worst", Right),
    ]);
    for Row { processor, counts } in rows {
        let late = (
            Some(counts.lateness_percentiles_us),
            Some(counts.worst_lateness_us),
        );
        let run = (counts.run_percentiles_us, counts.worst_run_us);
        for (what, (times, worst)) in [("late", late), ("run", run)] {
            let shown = |at: fn(Percentiles) -> f64| or_dash(times.map(at).map(tenths));
            table.row([
                processor.clone(),
                counts.name.clone(),
                what.into(),
                shown(|it| it.p50),
                shown(|it| it.p99),
                shown(|it| it.p99_9),
                or_dash(worst.map(tenths)),
            ]);
        }
    }
    if rows.is_empty() {
        String::new()
    } else {
        format!("\n{table}")
    }
}

/// Returns a line for each loop that runs faster or takes longer than `servo_loops` of its processor declares, and for
/// each declared loop that its program does not have.
pub(crate) fn beyond_declared(
    rows: &[Row<LoopRates>],
    processors: &[ProcessorEntry],
) -> Vec<String> {
    let mut beyond = Vec::new();
    for processor in processors {
        let of = &processor.name;
        let there = || rows.iter().filter(|row| row.processor == *of);
        for declared in &processor.servo_loops {
            let name = &declared.name;
            let Some(Row { counts, .. }) = there().find(|row| row.counts.name == *name) else {
                if there().next().is_some() {
                    beyond.push(format!(
                        "{of}: its program has no loop `{name}`, which `servo_loops` declares"
                    ));
                }
                continue;
            };
            let (hz, us) = (declared.hz, declared.worst_us);
            if counts.rate_hz > f64::from(hz) {
                let now = counts.rate_hz;
                beyond.push(format!(
                    "{of}: `{name}` is set to {now} Hz, but `servo_loops` declares {hz} Hz"
                ));
            }
            if let Some(worst) = counts.worst_run_us.filter(|worst| *worst > us.into()) {
                beyond.push(format!(
                    "{of}: `{name}` took {worst:.1} µs, but `servo_loops` declares {us} µs: correct `worst_us`, then `condor check`"
                ));
            }
        }
    }
    beyond
}

fn tenths(value: f64) -> String {
    format!("{value:.1}")
}

pub(crate) fn table_of_vectors(rows: &[Row<VectorCounts>]) -> TextTable<7> {
    let mut table = TextTable::new([
        ("processor", Left),
        ("vector", Right),
        ("name", Left),
        ("handled", Right),
        ("worst µs", Right),
        ("sent", Right),
        ("failed", Right),
    ]);
    for Row { processor, counts } in rows {
        let has_handler = !counts.name.is_empty();
        let handled = |text: String| if has_handler { text } else { "-".into() };
        table.row([
            processor.clone(),
            counts.vector.to_string(),
            handled(counts.name.clone()),
            handled(counts.handled.to_string()),
            handled(format!("{:.1}", counts.worst_us)),
            counts.sent.to_string(),
            counts.failed.to_string(),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use condor_host::application::Programs;
    use condor_host::description::SystemDescription;

    use super::*;

    #[test]
    fn interrupts_without_a_driver_and_without_end_are_named() {
        let counts = BoardInterrupts {
            served: 4000,
            spurious: 0,
            unclaimed: 2,
            unhandled: 3,
            stuck: 1,
            unhandled_vectors: vec![140, 11],
            stuck_vectors: vec![128],
            unhandled_causes: vec![],
        };
        let processor = "servo".to_owned();
        let table = table_of_interrupts(&[Row { processor, counts }]);
        let expected = "\n\
            processor  interrupts  unclaimed  unhandled  stuck  spurious  vectors\n\
            servo            4000          2          3      1         0  without a driver: 140, 11; stuck: 128\n";
        assert_eq!(table, expected);
        assert_eq!(table_of_interrupts(&[]), "");
    }

    #[test]
    fn loops_beyond_their_declarations_are_named() {
        let keys = [
            "name = \"tested\"\nwindow_bytes = 4096\n",
            "[[processors]]\nnumber = 1\nname = \"a\"\nprogram = \"/bin/true\"\nservo_loops = [\n",
            "{ name = \"servo\", hz = 400, worst_us = 300 }, { name = \"log\", hz = 1, worst_us = 100 }]\n",
        ];
        let file = Path::new("/x/tested.toml");
        let described =
            SystemDescription::from_toml(&keys.concat(), file, &Programs::default()).unwrap();
        let row = |processor: &str, name: &str, rate_hz, worst_run_us| Row {
            processor: processor.to_owned(),
            counts: LoopRates {
                name: name.into(),
                rate_hz,
                worst_run_us,
                ..LoopRates::default()
            },
        };
        let beyond = |rows: &[_]| beyond_declared(rows, &described.processors);
        // Those of a program that does not run, and of a processor that declares nothing.
        assert!(beyond(&[]).is_empty());
        assert!(beyond(&[row("b", "servo", 1e6, Some(1e6))]).is_empty());
        let [servo, log] = [
            row("a", "servo", 400.0, Some(300.0)),
            row("a", "log", 0.5, None),
        ];
        assert!(beyond(&[servo, log]).is_empty());
        let found = beyond(&[row("a", "servo", 400.5, Some(300.2))]);
        let expected = [
            "a: `servo` is set to 400.5 Hz, but `servo_loops` declares 400 Hz",
            "a: `servo` took 300.2 µs, but `servo_loops` declares 300 µs: correct `worst_us`, then `condor check`",
            "a: its program has no loop `log`, which `servo_loops` declares",
        ];
        assert_eq!(found, expected);
    }
}
