//! `condor vars watch`, and single looks at what is watched.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use condor_hand::monitor::Variable;
use condor_mbox::{Messenger, Processor};
use serde_json::{Map, Value as Json, json};

use super::known::{Known, One, What};
use crate::cli::{AnyError, duration};
use crate::commands::running::Running;
use crate::commands::table::or_dash;
use crate::commands::top::interrupted;
use crate::commands::{How, print};
use crate::control::Member;
use crate::plain::{plain, plain_json};
use crate::view::View;
use crate::view::variables::{self, Sample, Value};

/// How often rows are fetched.
const LOOK: Duration = Duration::from_millis(5);
/// How long the first row may take.
const FIRST: Duration = Duration::from_secs(2);

#[derive(Debug, Args)]
pub(crate) struct Watch {
    #[arg(required = true)]
    names: Vec<String>,
    /// A row every so many servo ticks
    #[arg(long, value_name = "TICKS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Ends after this time
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
        let members: Vec<&Member> = running.status.processors.iter().collect();
        let known = Known::all(&view, &members)?;
        let mut chosen = Vec::new();
        for name in &self.names {
            let one = known.find(name)?;
            let What::Variable(number, variable) = &one.what else {
                return Err(format!(
                    "`{name}` is a gain, which only changes when it is set; \
                     `vars get {name}` shows it"
                )
                .into());
            };
            chosen.push((one.member, *number, variable));
        }
        let [(member, ..), ..] = chosen.as_slice() else {
            return Ok(());
        };
        if let Some((other, ..)) = chosen.iter().find(|(it, ..)| it.number != member.number) {
            return Err(format!(
                "a row is of one processor: watch the variables of {} and of {} with a command each",
                member.name, other.name
            )
            .into());
        }
        let columns: Vec<_> = chosen
            .iter()
            .map(|(_, number, it)| (*number, *it))
            .collect();
        self.watch(&view, Processor(member.number), &columns)
    }

    fn watch(
        &self,
        view: &View,
        processor: Processor,
        columns: &[(usize, &Variable)],
    ) -> Result<(), AnyError> {
        let Some(monitor) = view.monitor(processor)? else {
            return Err(format!("{processor} has no monitor any more").into());
        };
        let end = interrupted()?;
        let numbers: Vec<usize> = columns.iter().map(|(number, _)| *number).collect();
        let mut watch = monitor.watch(view.post(), &numbers, self.every)?;
        let begun = Instant::now();
        let outcome = self.rows(view, &mut watch, columns, || {
            end.load(Ordering::Relaxed) || self.limit.is_some_and(|limit| begun.elapsed() >= limit)
        });
        let lost = watch.lost();
        let ended = watch.end();
        let rows = outcome?;
        ended?;
        if self.how.json {
            return print(format_args!("{}\n", json!({ "rows": rows, "lost": lost })));
        }
        eprintln!("{rows} rows, {lost} lost");
        Ok(())
    }

    fn rows(
        &self,
        view: &View,
        watch: &mut variables::Watch<'_>,
        columns: &[(usize, &Variable)],
        ends: impl Fn() -> bool,
    ) -> Result<u64, AnyError> {
        if !self.how.json {
            print(titles(columns))?;
        }
        let mut rows = 0;
        let begun = Instant::now();
        while !ends() {
            let mut text = String::new();
            while let Some(sample) = watch.sample()? {
                rows += 1;
                if self.how.json {
                    text += &plain_json(&object(&sample, columns))?;
                    text.push('\n');
                } else {
                    text += &line(&sample, columns);
                }
                if ends() {
                    break;
                }
            }
            print(text)?;
            if rows == 0 && begun.elapsed() >= FIRST.max(self.limit.unwrap_or_default()) {
                return Err("its servo loop writes no rows: is it enabled? see `top`".into());
            }
            view.post().serve(LOOK)?;
        }
        Ok(rows)
    }
}

fn width(variable: &Variable) -> usize {
    (variable.name.len() + variable.unit.len() + 3).max(12)
}

fn titles(columns: &[(usize, &Variable)]) -> String {
    let cells = columns.iter().map(|(_, variable)| {
        let title = match variable.unit.as_str() {
            "" => variable.name.to_string(),
            unit => format!("{} [{unit}]", variable.name),
        };
        format!("  {:>1$}", plain(&title), width(variable))
    });
    core::iter::once(format!("{:>10}", "tick"))
        .chain(cells)
        .chain(["\n".into()])
        .collect()
}

fn line(sample: &Sample, columns: &[(usize, &Variable)]) -> String {
    let cells = columns.iter().map(|(number, variable)| {
        let value = or_dash(sample.value(*number, variable));
        format!("  {value:>0$}", width(variable))
    });
    core::iter::once(format!("{:>10}", sample.tick))
        .chain(cells)
        .chain(["\n".into()])
        .collect()
}

fn object(sample: &Sample, columns: &[(usize, &Variable)]) -> Json {
    let mut object = Map::new();
    object.insert("tick".into(), sample.tick.into());
    for (number, variable) in columns {
        let value = sample.value(*number, variable);
        object.insert(variable.name.to_string(), json!(value));
    }
    Json::Object(object)
}

/// The present values of those that are variables, in the order of `chosen`.
pub(super) fn once(view: &View, chosen: &[&One<'_>]) -> Result<Vec<Option<Value>>, AnyError> {
    let mut values = vec![None; chosen.len()];
    let mut of_processor: BTreeMap<u8, Vec<(usize, usize, &Variable)>> = BTreeMap::new();
    for (place, one) in chosen.iter().enumerate() {
        if let What::Variable(number, variable) = &one.what {
            let of_processor = of_processor.entry(one.member.number).or_default();
            of_processor.push((place, *number, variable));
        }
    }
    for (processor, variables) in of_processor {
        let Some(monitor) = view.monitor(Processor(processor))? else {
            continue;
        };
        let numbers: Vec<usize> = variables.iter().map(|(_, number, _)| *number).collect();
        let mut watch = monitor.watch(view.post(), &numbers, 1)?;
        let sample = first(view, &mut watch);
        watch.end()?;
        let sample = sample?.ok_or_else(|| {
            let processor = Processor(processor);
            format!("the servo loop of {processor} writes no rows: is it enabled? see `top`")
        })?;
        for (place, number, variable) in variables {
            if let Some(value) = values.get_mut(place) {
                *value = sample.value(number, variable);
            }
        }
    }
    Ok(values)
}

fn first(view: &View, watch: &mut variables::Watch<'_>) -> Result<Option<Sample>, AnyError> {
    let begun = Instant::now();
    while begun.elapsed() < FIRST {
        if let Some(sample) = watch.sample()? {
            return Ok(Some(sample));
        }
        view.post().serve(LOOK)?;
    }
    Ok(None)
}
