//! `condor vars watch`.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use condor_vars::{AnyValue, Merge, MergedRow};
use serde_json::{Map, Value as Json, json};

use crate::commands::number::duration;
use crate::commands::running::Running;
use crate::commands::{How, print};
use condor_host::error::{AnyError, tell};
use condor_host::plain::{plain, plain_json};
use condor_host::signals;
use condor_host::view::View;
use condor_host::watching::{
    self, CatalogEntry, NewPrograms, RowSource, Rows, SourceRow, VariableCatalog, patience, silence,
};

/// The time for which the rows of a loop wait for those of a silent one.
const HORIZON: Duration = Duration::from_millis(200);

#[derive(Debug, Args)]
pub(crate) struct Watch {
    /// The names of variables, of any loops; if several are equal, put PROCESSOR: or PROCESSOR:LOOP: before the
    /// name. In a name, * stands for any characters, and ? for one
    #[arg(required = true)]
    names: Vec<String>,
    /// Shows a row of each loop only once in this number of ticks
    #[arg(long, value_name = "TICKS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Ends after this time, such as 10s
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    limit: Option<Duration>,
    #[command(flatten)]
    how: How,
}

impl Watch {
    pub(super) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let known = VariableCatalog::all(&view, &running.status.processors)?;
        let columns = known.matching(&self.names)?;
        let end = signals::flag()?;
        let mut rows = Rows::of(&view, &columns, self.every)?;
        let labels = known.labels(&columns);
        let columns = labels.into_iter().zip(columns).collect();
        let mut lines = Lines::new(columns, &rows.sources, self.how.json);
        print(lines.titles())?;
        let begun = Instant::now();
        let ends = || {
            end.load(Ordering::Relaxed) || self.limit.is_some_and(|limit| begun.elapsed() >= limit)
        };
        let newcomers = NewPrograms::after(&known, &running.status.processors, &self.names);
        self.show(&view, &running, (&mut rows, newcomers), &mut lines, ends)?;
        self.summary(&rows.sources)
    }

    /// Shows rows until it `ends`.
    fn show(
        &self,
        view: &View,
        running: &Running,
        (rows, mut newcomers): (&mut Rows<'_>, NewPrograms),
        lines: &mut Lines<'_>,
        ends: impl Fn() -> bool,
    ) -> Result<(), AnyError> {
        let patience = patience(&rows.sources, self.every);
        let mut merge = Merge::new(rows.sources.len(), HORIZON);
        let mut last = Instant::now();
        loop {
            let is_end = ends();
            let read = rows.read(|source, row| {
                merge.push(source, row.released, Sample::of(row, lines.columns.len()));
            });
            for change in rows.changes() {
                tell(plain(&change.text));
            }
            // Its columns are fixed.
            for place in watching::places(&newcomers.look(view)) {
                let place = plain(&place);
                tell(format_args!(
                    "{place} started later and is not shown; run the command again to watch it"
                ));
            }
            let mut ready: Vec<_> = core::iter::from_fn(|| merge.pop()).collect();
            if is_end || read.is_err() {
                ready.extend(merge.finish());
            }
            print(lines.of(&ready)?)?;
            read?;
            if is_end {
                return Ok(());
            }
            if !ready.is_empty() {
                last = Instant::now();
            } else if last.elapsed() >= patience {
                running.check()?;
                let silent = rows.silent();
                if silent.len() == rows.sources.len() {
                    return Err(silence(&silent).into());
                }
                last = Instant::now();
            }
            rows.pause()?;
        }
    }

    /// Tells how many rows there were.
    fn summary(&self, sources: &[RowSource]) -> Result<(), AnyError> {
        if !self.how.json {
            for source in sources {
                let (name, kept) = (source.name(), source.kept(source.rows));
                eprintln!("{}: {kept}", plain(&name));
            }
            return Ok(());
        }
        let loops: Vec<_> = sources
            .iter()
            .map(|it| {
                let (lost, skipped) = (it.lost(), it.skipped());
                json!({ "loop": it.name(), "rows": it.rows, "lost": lost, "skipped": skipped })
            })
            .collect();
        let rows: u64 = sources.iter().map(|source| source.rows).sum();
        let lost: u64 = sources.iter().map(RowSource::lost).sum();
        let summary = json!({ "rows": rows, "lost": lost, "loops": loops });
        print(format_args!("{}\n", plain_json(&summary)?))
    }
}

/// The values of variables of one loop in one tick.
struct Sample {
    tick: u64,
    released: condor_mbox::Instant,
    lost: u32,
    /// The value for each column; `None` for variables of other loops.
    values: Vec<Option<AnyValue>>,
}

impl Sample {
    fn of(row: &SourceRow<'_>, columns: usize) -> Self {
        let mut values = vec![None; columns];
        for (field, value) in row.values() {
            for column in &field.columns {
                if let Some(place) = values.get_mut(*column) {
                    *place = Some(value);
                }
            }
        }
        let (tick, released, lost) = (row.tick, row.released, row.lost);
        Self {
            tick,
            released,
            lost,
            values,
        }
    }
}

/// Rows as lines of text, or of JSON.
struct Lines<'s> {
    columns: Vec<(String, &'s CatalogEntry)>,
    titles: Vec<String>,
    /// The loops, by the number of the source, and the width of their column.
    loops: Vec<String>,
    width: usize,
    is_json: bool,
    /// The time of the first row.
    begin: Option<condor_mbox::Instant>,
}

impl<'s> Lines<'s> {
    fn new(columns: Vec<(String, &'s CatalogEntry)>, sources: &[RowSource], is_json: bool) -> Self {
        let title = |(name, one): &(String, &CatalogEntry)| match one.entry.unit.as_str() {
            "" => format!("{name:>12}"),
            unit => format!("{:>12}", format!("{name} [{unit}]")),
        };
        let loops: Vec<_> = sources.iter().map(RowSource::name).collect();
        Self {
            titles: columns.iter().map(title).collect(),
            columns,
            width: loops.iter().map(String::len).max().unwrap_or(0),
            loops,
            is_json,
            begin: None,
        }
    }

    fn titles(&self) -> String {
        if self.is_json {
            return String::new();
        }
        let head = ["time [s]", "loop", "tick"].map(String::from);
        self.line(head, self.titles.iter().cloned())
    }

    fn of(&mut self, rows: &[MergedRow<Sample>]) -> Result<String, AnyError> {
        let mut text = String::new();
        for row in rows {
            let owner = self.loops.get(row.source).cloned().unwrap_or_default();
            if self.is_json {
                text += &plain_json(&self.object(row, &owner))?;
                text.push('\n');
            } else {
                let begin = *self.begin.get_or_insert(row.at);
                // A row that comes late may be before the first.
                let since = row.at.as_ns().wrapping_sub(begin.as_ns()).cast_signed();
                #[expect(clippy::cast_precision_loss, reason = "microseconds are shown")]
                let time = format!("{:.6}", since as f64 / 1e9);
                let values = self.columns.iter().zip(&row.item.values);
                let values = values.map(|((_, one), value)| {
                    value.map(|value| one.of.brief(value)).unwrap_or_default()
                });
                text += &self.line([time, owner, row.item.tick.to_string()], values);
            }
        }
        Ok(text)
    }

    fn line(
        &self,
        [time, owner, tick]: [String; 3],
        cells: impl Iterator<Item = String>,
    ) -> String {
        let owners = self.width;
        let head = format!("{time:>12}  {:owners$}  {tick:>10}", plain(&owner));
        let cells = cells.zip(&self.titles).map(|(cell, title)| {
            let width = title.chars().count();
            format!("  {:>width$}", plain(&cell))
        });
        let line: String = core::iter::once(head).chain(cells).collect();
        format!("{}\n", line.trim_end())
    }

    fn object(&self, row: &MergedRow<Sample>, owner: &str) -> Json {
        let mut values = Map::new();
        for ((name, one), value) in self.columns.iter().zip(&row.item.values) {
            if let Some(value) = value {
                values.insert(name.clone(), one.of.json(*value));
            }
        }
        let (tick, released_ns, lost) = (row.item.tick, row.item.released.as_ns(), row.item.lost);
        json!({
            "loop": owner, "tick": tick, "released_ns": released_ns, "lost": lost, "values": values
        })
    }
}
