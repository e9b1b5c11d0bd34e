//! `condor vars`: what can be watched, and what can be set.

mod known;
mod watch;

use clap::{Args, Subcommand};
use serde::Serialize;

use super::running::Running;
use super::table::{Left, Right, Table, or_dash};
use super::{How, print, print_json};
use crate::cli::AnyError;
use crate::control::Member;
use crate::view::variables::Value;
use known::{Known, What};

#[derive(Debug, Subcommand)]
pub(crate) enum Vars {
    /// Lists variables, which can be watched, and gains, which can be set
    List(List),
    /// Shows the present values of some
    Get(Get),
    /// Sets a gain
    Set(Set),
    /// Shows variables at the rate of their servo, until Ctrl-C
    Watch(watch::Watch),
}

#[derive(Debug, Args)]
pub(crate) struct List {
    /// The name or the number of one processor
    processor: Option<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Args)]
pub(crate) struct Get {
    #[arg(required = true)]
    names: Vec<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Args)]
pub(crate) struct Set {
    name: String,
    #[arg(allow_negative_numbers = true)]
    value: f64,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Row<'s> {
    processor: &'s str,
    name: &'s str,
    unit: &'s str,
    can_be_set: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<Shown>,
}

#[derive(Clone, Copy, Serialize)]
#[serde(untagged)]
enum Shown {
    Variable(Value),
    Gain(f64),
}

impl core::fmt::Display for Shown {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Variable(value) => value.fmt(f),
            Self::Gain(value) => f.pad(&value.to_string()),
        }
    }
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    variables: &'s [Row<'s>],
}

#[derive(Serialize)]
struct Changed<'s> {
    name: &'s str,
    before: f64,
    value: f64,
}

impl Vars {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        match self {
            Self::List(list) => list.run(),
            Self::Get(get) => get.run(),
            Self::Set(set) => set.run(),
            Self::Watch(watch) => watch.run(),
        }
    }
}

impl List {
    fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let members: Vec<&Member> = match &self.processor {
            Some(text) => vec![running.processor(text)?],
            None => running.status.processors.iter().collect(),
        };
        let mut view = running.view()?;
        view.join()?;
        let known = Known::all(&view, &members)?;
        let rows: Vec<_> = known.all.iter().map(row).collect();
        show(&rows, &running, &self.how)?;
        known.tell_troubles();
        Ok(())
    }
}

impl Get {
    fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let members: Vec<&Member> = running.status.processors.iter().collect();
        let known = Known::all(&view, &members)?;
        let chosen: Result<Vec<_>, _> = self.names.iter().map(|name| known.find(name)).collect();
        let chosen = chosen?;
        let values = watch::once(&view, &chosen)?;
        let mut rows = Vec::new();
        for (place, one) in chosen.iter().enumerate() {
            let watched = values.get(place).copied().flatten();
            let mut row = row(one);
            row.value = watched.map(Shown::Variable).or(row.value);
            rows.push(row);
        }
        show(&rows, &running, &self.how)
    }
}

impl Set {
    fn run(&self) -> Result<(), AnyError> {
        let (name, value) = (&self.name, self.value);
        if !value.is_finite() {
            return Err(format!("a gain is a finite number, and not {value}").into());
        }
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let members: Vec<&Member> = running.status.processors.iter().collect();
        let known = Known::all(&view, &members)?;
        let found = known.find(name)?;
        let What::Gain(gain, _) = &found.what else {
            return Err(format!(
                "`{name}` is what a controller measures or computes, and cannot be set; {}",
                known.gains_like(name)
            )
            .into());
        };
        let servos = view.servos(condor_mbox::Processor(found.member.number))?;
        let before = match servos {
            Some(mut servos) => servos.set(gain, value)?,
            None => None,
        };
        let before = before.ok_or_else(|| format!("`{name}` is not there any more"))?;
        if self.how.json {
            return print_json(&Changed {
                name,
                before,
                value,
            });
        }
        print(format_args!("{name}: {before} -> {value} {}\n", gain.unit))
    }
}

fn row<'s>(one: &'s known::One<'_>) -> Row<'s> {
    let (value, can_be_set) = match &one.what {
        What::Gain(_, value) => (Some(Shown::Gain(*value)), true),
        What::Variable(..) => (None, false),
    };
    Row {
        processor: &one.member.name,
        name: one.what.name(),
        unit: one.what.unit(),
        can_be_set,
        value,
    }
}

fn show(rows: &[Row<'_>], running: &Running, how: &How) -> Result<(), AnyError> {
    if how.json {
        let system = &running.status.system;
        return print_json(&Answer {
            system,
            variables: rows,
        });
    }
    let mut table = Table::new([
        ("processor", Left),
        ("name", Left),
        ("value", Right),
        ("unit", Left),
        ("", Left),
    ]);
    for row in rows {
        table.row([
            row.processor.into(),
            row.name.into(),
            or_dash(row.value),
            row.unit.into(),
            if row.can_be_set { "can be set" } else { "" }.into(),
        ]);
    }
    print(table)
}
