//! `condor vars`: what can be watched, and what can be set.

mod diff;
mod file;
mod store;
mod watch;

use std::process::ExitCode;

use clap::{Args, Subcommand};
use condor_vars::AnyValue;
use serde::Serialize;
use serde_json::Value as Json;

use super::running::Running;
use super::{How, print, print_json};
use crate::table::{Left, Right, TextTable, or_dash};
use condor_host::answers::{Variable, all_values, values, variable};
use condor_host::application::Application;
use condor_host::error::AnyError;
use condor_host::watching::{CatalogEntry, Clients, VariableCatalog};

#[derive(Debug, Subcommand)]
pub(crate) enum Vars {
    /// Lists variables, parameters (which can be set) and fields of published cells
    List(List),
    /// Shows the present values of variables, parameters and fields
    Get(Get),
    /// Sets a parameter to a new value
    Set(Set),
    /// Writes the present values of all parameters to a file
    Save(store::Save),
    /// Sets the parameters of a file: all of them, or none if one cannot have its value
    Load(store::Load),
    /// Compares parameters with what the description, or a file, says
    ///
    /// The exit status is 0 if none differs, 1 if one does, and 2 if they cannot be compared.
    Diff(diff::Diff),
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
    /// The names of variables; if several are equal, put PROCESSOR: or PROCESSOR:LOOP: before the name. In a name,
    /// * stands for any characters, and ? for one
    #[arg(required = true)]
    names: Vec<String>,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Args)]
pub(crate) struct Set {
    /// The name of the parameter; if several are equal, put PROCESSOR: or PROCESSOR:LOOP: before it
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
struct Answer<'s> {
    system: &'s str,
    variables: Vec<Variable<'s>>,
}

#[derive(Serialize)]
struct ParamChange<'s> {
    name: &'s str,
    before: Json,
    value: Json,
}

impl Vars {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<ExitCode, AnyError> {
        match self {
            Self::List(list) => list.run()?,
            Self::Get(get) => get.run()?,
            Self::Set(set) => set.run()?,
            Self::Save(save) => save.run()?,
            Self::Load(load) => load.run()?,
            Self::Diff(diff) => return diff.run(application),
            Self::Watch(watch) => watch.run()?,
        }
        Ok(ExitCode::SUCCESS)
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
        let mut known = VariableCatalog::all(&view, members)?;
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
        let known = VariableCatalog::all(&view, &running.status.processors)?;
        let chosen = known.matching(&self.names)?;
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
        let known = VariableCatalog::all(&view, &running.status.processors)?;
        let one = known.parameter(name)?;
        let parse = |text| {
            let value = one.of.parse(text);
            value.map_err(|error| format!("`{name}`: {error}; it can be set to {}", choices(one)))
        };
        let new = parse(&self.value)?;
        let from = self.from.as_deref().map(parse);
        let mut clients = Clients::new(&view);
        let before = clients.set(name, one, from.transpose()?, new)?;
        if self.how.json {
            return print_json(&ParamChange {
                name,
                before: one.of.json(before),
                value: one.of.json(new),
            });
        }
        let (before, new, unit) = (one.of.text(before), one.of.text(new), &one.entry.unit);
        let text = format!("{name}: {before} -> {new} {unit}");
        print(format_args!(
            "{}\n",
            condor_host::plain::plain(text.trim_end())
        ))
    }
}

fn show<'s>(
    rows: impl Iterator<Item = (&'s CatalogEntry, Option<AnyValue>)>,
    running: &Running,
    how: &How,
) -> Result<(), AnyError> {
    if how.json {
        return print_json(&Answer {
            system: &running.status.system,
            variables: rows.map(|(one, value)| variable(one, value)).collect(),
        });
    }
    let mut table = TextTable::new([
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

/// Says what a parameter can be set to.
fn choices(one: &CatalogEntry) -> String {
    match one.entry.bounds {
        None => String::new(),
        Some([AnyValue::Bool(false), AnyValue::Bool(true)]) => "true or false".into(),
        Some([AnyValue::Choice(least), AnyValue::Choice(greatest)]) => {
            let choices: Vec<_> = (least..=greatest)
                .take(one.of.labels.len())
                .map(|number| one.of.text(AnyValue::Choice(number)))
                .collect();
            choices.join(", ")
        }
        Some([least, greatest]) => {
            format!("{} to {}", one.of.text(least), one.of.text(greatest))
        }
    }
}
