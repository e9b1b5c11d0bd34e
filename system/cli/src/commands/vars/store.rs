//! `condor vars save` and `condor vars load`.

use std::path::PathBuf;

use clap::Args;
use condor_host::error::{AnyError, NamedFileError, tell};
use condor_host::plain::{plain, plain_lines};
use condor_host::watching::{CatalogEntry, Clients, VariableCatalog};
use condor_platform::linux::WholeFile;
use condor_vars::AnyValue;
use serde::Serialize;
use serde_json::Value as Json;

use super::file;
use crate::commands::running::Running;
use crate::commands::{How, print, print_json};

#[derive(Debug, Args)]
pub(crate) struct Save {
    /// The file to write; one that is there is replaced
    file: PathBuf,
    #[command(flatten)]
    how: How,
}

#[derive(Debug, Args)]
pub(crate) struct Load {
    /// The file, which `vars save` has written
    file: PathBuf,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct SaveAnswer<'s> {
    system: &'s str,
    file: String,
    parameters: usize,
}

#[derive(Serialize)]
struct LoadAnswer<'s> {
    system: &'s str,
    file: String,
    parameters: usize,
    changed: Vec<LoadChange<'s>>,
}

#[derive(Serialize)]
struct LoadChange<'s> {
    processor: &'s str,
    #[serde(rename = "loop")]
    owner: &'s str,
    name: &'s str,
    before: Json,
    value: Json,
}

/// A new value of a parameter, and the value before it.
struct Change<'c> {
    one: &'c CatalogEntry,
    before: AnyValue,
    new: AnyValue,
}

impl Save {
    pub(super) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let known = VariableCatalog::all(&view, &running.status.processors)?;
        known.tell_troubles();
        let mut clients = Clients::new(&view);
        let mut values = Vec::new();
        for one in known.all.iter().filter(|one| one.can_be_set()) {
            let value = clients.value(one);
            let value = value.map_err(|error| format!("{}: {error}", one.place()))?;
            values.extend(value.map(|value| (one, value)));
        }
        let (system, count) = (running.status.system.as_str(), values.len());
        let text = file::text(system, values.into_iter());
        let written = WholeFile::write(&self.file, text.as_bytes());
        written.map_err(NamedFileError::at("write", &self.file))?;
        let file = self.file.display().to_string();
        if self.how.json {
            return print_json(&SaveAnswer {
                system,
                file,
                parameters: count,
            });
        }
        print(format_args!("{file}: {count} parameters are saved\n"))
    }
}

impl Load {
    pub(super) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let known = VariableCatalog::all(&view, &running.status.processors)?;
        let written = file::read(&self.file, &known)?;
        let mut clients = Clients::new(&view);
        let mut changes = Vec::new();
        for parameter in &written {
            let one = parameter.one;
            let before = clients.value(one);
            let before = before.map_err(|error| format!("{}: {error}", one.place()))?;
            let new = parameter.value;
            changes.extend(before.filter(|before| *before != new).map(|before| Change {
                one,
                before,
                new,
            }));
        }
        set_all(&mut clients, &changes)?;
        self.answer(&running.status.system, written.len(), &changes)
    }

    fn answer(
        &self,
        system: &str,
        parameters: usize,
        changes: &[Change<'_>],
    ) -> Result<(), AnyError> {
        let file = self.file.display().to_string();
        if self.how.json {
            let answers = changes
                .iter()
                .map(|Change { one, before, new }| LoadChange {
                    processor: &one.member.name,
                    owner: &one.owner,
                    name: &one.name,
                    before: one.of.json(*before),
                    value: one.of.json(*new),
                });
            return print_json(&LoadAnswer {
                system,
                file,
                parameters,
                changed: answers.collect(),
            });
        }
        let mut text = String::new();
        for Change { one, before, new } in changes {
            let (place, name, unit) = (one.place(), &one.name, &one.entry.unit);
            let (before, new) = (one.of.text(*before), one.of.text(*new));
            let line = format!("{place}:{name}: {before} -> {new} {unit}");
            text.extend([&*plain(line.trim_end()), "\n"]);
        }
        let count = changes.len();
        print(format_args!(
            "{text}{file}: {parameters} parameters, of which {count} were set\n"
        ))
    }
}

/// Sets all parameters; if one is refused, sets those before it to what they were.
fn set_all(clients: &mut Clients<'_>, changes: &[Change<'_>]) -> Result<(), AnyError> {
    let name = |one: &CatalogEntry| format!("{}:{}", one.place(), one.name);
    for (count, change) in changes.iter().enumerate() {
        let one = change.one;
        let Err(error) = clients.set(&name(one), one, Some(change.before), change.new) else {
            continue;
        };
        let mut left = 0;
        for Change { one, before, new } in changes.iter().take(count).rev() {
            if let Err(error) = clients.set(&name(one), one, Some(*new), *before) {
                tell(plain_lines(&error.to_string()));
                left += 1;
            }
        }
        return Err(match left {
            0 => format!("{error}; all parameters are as before"),
            left => format!("{error}; of those before it, {left} could not be set back"),
        }
        .into());
    }
    Ok(())
}
