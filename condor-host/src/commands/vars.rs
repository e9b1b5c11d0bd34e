//! `condor vars`: what can be watched, and what can be set.

mod watch;

use std::collections::BTreeSet;

use clap::{Args, Subcommand};
use condor_vars::Value;
use serde::Serialize;
use serde_json::Value as Json;

use super::running::Running;
use super::{How, print, print_json};
use crate::control::Status;
use crate::error::AnyError;
use crate::table::{Left, Right, Table, or_dash};
use crate::view::View;
use crate::watching::{Clients, Known, One};

#[derive(Debug, Subcommand)]
pub(crate) enum Vars {
    /// Lists variables, parameters (which can be set) and fields of published cells
    List(List),
    /// Shows the present values of variables, parameters and fields
    Get(Get),
    /// Sets a parameter to a new value
    Set(Set),
    /// Shows variables and parameters at the rate of their loops, until Ctrl-C
    Watch(watch::Watch),
}

#[derive(Debug, Args)]
pub(crate) struct List {
    /// The name or the number of a processor; all of them by default
    processor: Option<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Args)]
pub(crate) struct Get {
    /// The names; if several are equal, put PROCESSOR: or PROCESSOR:LOOP: before the name
    #[arg(required = true)]
    names: Vec<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Args)]
pub(crate) struct Set {
    /// The name; if several are equal, put PROCESSOR: or PROCESSOR:LOOP: before it
    name: String,
    /// The new value: a number, true, false, or a label; a whole number may be hexadecimal, such as -0x10
    #[arg(allow_hyphen_values = true)]
    value: String,
    /// Sets the parameter only if this is its present value
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    from: Option<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Row<'s> {
    processor: &'s str,
    #[serde(rename = "loop", skip_serializing_if = "Option::is_none")]
    of_loop: Option<&'s str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cell: Option<&'s str>,
    name: &'s str,
    #[serde(rename = "type")]
    type_name: String,
    unit: &'s str,
    about: &'s str,
    can_be_set: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    bounds: Option<[Json; 2]>,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    labels: &'s [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<Json>,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    variables: Vec<Row<'s>>,
}

#[derive(Serialize)]
struct Changed<'s> {
    name: &'s str,
    before: Json,
    value: Json,
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
        let members = match &self.processor {
            Some(text) => core::slice::from_ref(running.processor(text)?),
            None => &running.status.processors,
        };
        let mut view = running.view()?;
        view.join()?;
        let mut known = Known::all(&view, members)?;
        let values = all_values(&mut known, &mut Clients::new(&view));
        show(known.all.iter().zip(values), &running, &self.how)?;
        known.tell_troubles();
        Ok(())
    }
}

impl Get {
    fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let known = Known::all(&view, &running.status.processors)?;
        let chosen: Result<Vec<_>, _> = self.names.iter().map(|name| known.find(name)).collect();
        let chosen = chosen?;
        let values = values(&mut Clients::new(&view), &chosen)?;
        show(chosen.into_iter().zip(values), &running, &self.how)
    }
}

impl Set {
    fn run(&self) -> Result<(), AnyError> {
        let name = &self.name;
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let known = Known::all(&view, &running.status.processors)?;
        let one = known.parameter(name)?;
        let new = one.of.parse(&self.value)?;
        let from = self.from.as_deref().map(|text| one.of.parse(text));
        let mut clients = Clients::new(&view);
        let before = clients.set(name, one, from.transpose()?, new)?;
        if self.how.json {
            return print_json(&Changed {
                name,
                before: one.of.json(before),
                value: one.of.json(new),
            });
        }
        let (before, new, unit) = (one.of.text(before), one.of.text(new), &one.entry.unit);
        let text = format!("{name}: {before} -> {new} {unit}");
        print(format_args!("{}\n", crate::plain::plain(text.trim_end())))
    }
}

/// Returns the `variables` that `vars list --json` prints, or with `names` those that `vars get --json` prints.
///
/// # Errors
/// An error that says which name is unknown, or which value cannot be had.
pub fn answer(
    status: &Status,
    view: &View,
    clients: &mut Clients<'_>,
    names: &[String],
) -> Result<Json, AnyError> {
    let mut known = Known::all(view, &status.processors)?;
    let (chosen, values): (Vec<_>, _) = if names.is_empty() {
        let values = all_values(&mut known, clients);
        (known.all.iter().collect(), values)
    } else {
        let chosen = names.iter().map(|name| known.find(name));
        let chosen = chosen.collect::<Result<Vec<_>, _>>()?;
        let values = values(clients, &chosen)?;
        (chosen, values)
    };
    let rows = chosen.into_iter().zip(values);
    let rows: Vec<_> = rows.map(|(one, value)| row(one, value)).collect();
    Ok(serde_json::to_value(rows)?)
}

/// Returns the values of all parameters and fields that can be had, and `None` for others.
fn all_values(known: &mut Known, clients: &mut Clients<'_>) -> Vec<Option<Value>> {
    let (mut values, mut silent) = (Vec::new(), BTreeSet::new());
    for one in &known.all {
        let is_silent = one.can_be_set() && silent.contains(&one.member.number);
        let value = (!is_silent).then(|| clients.value(one));
        // A cell of which nothing has been published yet has no value.
        if one.can_be_set()
            && let Some(Err(error)) = &value
        {
            silent.insert(one.member.number);
            known.troubles.push(format!("{}: {error}", one.place()));
        }
        values.push(value.and_then(Result::ok).flatten());
    }
    values
}

/// Returns the present values of some variables, parameters and fields.
///
/// # Errors
/// An error that says which value cannot be had.
pub fn values(clients: &mut Clients<'_>, chosen: &[&One]) -> Result<Vec<Option<Value>>, AnyError> {
    let mut values = watch::once(clients, chosen)?;
    for (one, value) in chosen.iter().zip(&mut values) {
        let asked = clients.value(one);
        let asked = asked.map_err(|error| format!("{}: {error}", one.place()))?;
        *value = value.or(asked);
    }
    Ok(values)
}

fn show<'s>(
    rows: impl Iterator<Item = (&'s One, Option<Value>)>,
    running: &Running,
    how: &How,
) -> Result<(), AnyError> {
    if how.json {
        return print_json(&Answer {
            system: &running.status.system,
            variables: rows.map(|(one, value)| row(one, value)).collect(),
        });
    }
    let mut table = Table::new([
        ("processor", Left),
        ("in", Left),
        ("name", Left),
        ("value", Right),
        ("unit", Left),
        ("type", Left),
        ("can be set to", Left),
        ("", Left),
    ]);
    for (one, value) in rows {
        table.row([
            one.member.name.clone(),
            one.owner.to_string(),
            one.name.clone(),
            or_dash(value.map(|value| one.of.text(value))),
            one.entry.unit.to_string(),
            one.of.to_string(),
            choices(one),
            one.entry.about.to_string(),
        ]);
    }
    print(table)
}

fn row(one: &One, value: Option<Value>) -> Row<'_> {
    let owner = Some(&*one.owner);
    let (of_loop, cell) = if one.is_field() {
        (None, owner)
    } else {
        (owner, None)
    };
    Row {
        processor: &one.member.name,
        of_loop,
        cell,
        name: &one.name,
        type_name: one.of.to_string(),
        unit: &one.entry.unit,
        about: &one.entry.about,
        can_be_set: one.can_be_set(),
        bounds: (one.entry.bounds).map(|bounds| bounds.map(|bound| one.of.json(bound))),
        labels: &one.of.labels,
        value: value.map(|value| one.of.json(value)),
    }
}

/// Says what a parameter can be set to.
fn choices(one: &One) -> String {
    match one.entry.bounds {
        None => String::new(),
        Some([Value::Choice(least), Value::Choice(greatest)]) => {
            let choices: Vec<_> = (least..=greatest)
                .take(one.of.labels.len())
                .map(|number| one.of.text(Value::Choice(number)))
                .collect();
            choices.join(", ")
        }
        Some([least, greatest]) => {
            format!("{} to {}", one.of.text(least), one.of.text(greatest))
        }
    }
}
