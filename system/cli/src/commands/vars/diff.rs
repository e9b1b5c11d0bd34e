//! `condor vars diff`.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use condor_host::application::Application;
use condor_host::description::SystemDescription;
use condor_host::error::{AnyError, tell};
use condor_host::plain::plain_lines;
use condor_host::robot::DescribedKey;
use condor_host::watching::{CatalogEntry, Clients, VariableCatalog};
use condor_vars::AnyValue;
use serde::Serialize;
use serde_json::Value as Json;

use super::file;
use crate::commands::running::Running;
use crate::commands::{How, print, print_json};
use crate::table::{Left, Right, TextTable};

#[derive(Debug, Args)]
pub(crate) struct Diff {
    /// A file that `vars save` has written; by default the values with which the programs began, which are those of the
    /// description
    file: Option<PathBuf>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Answer<'s> {
    system: &'s str,
    compared: usize,
    differences: Vec<Difference<'s>>,
}

#[derive(Serialize)]
struct Difference<'s> {
    processor: &'s str,
    #[serde(rename = "loop")]
    owner: &'s str,
    name: &'s str,
    unit: &'s str,
    described: Json,
    present: Json,
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    key: Option<String>,
}

/// A parameter with its described and its present value, and the line of a file that says the described one.
struct Compared<'c> {
    one: &'c CatalogEntry,
    described: AnyValue,
    present: AnyValue,
    line: Option<usize>,
}

/// The place that says a described value.
#[derive(Default)]
struct Source {
    file: Option<String>,
    line: Option<usize>,
    key: Option<String>,
}

impl Diff {
    /// Returns 0 if nothing differs, 1 if something does, and 2 if that is not known.
    pub(super) fn run(&self, application: &dyn Application) -> Result<ExitCode, AnyError> {
        match self.compare(application) {
            // The reader of the output has seen enough of it.
            Err(error)
                if (error.downcast_ref::<io::Error>())
                    .is_some_and(|error| error.kind() == ErrorKind::BrokenPipe) =>
            {
                Err(error)
            }
            Err(error) => {
                // Names that programs have chosen may be in it.
                tell(plain_lines(&error.to_string()));
                Ok(ExitCode::from(2))
            }
            Ok(is_equal) => Ok(ExitCode::from(u8::from(!is_equal))),
        }
    }

    fn compare(&self, application: &dyn Application) -> Result<bool, AnyError> {
        let running = Running::find(&self.how.which)?;
        let mut view = running.view()?;
        view.join()?;
        let known = VariableCatalog::all(&view, &running.status.processors)?;
        known.tell_troubles();
        let mut clients = Clients::new(&view);
        let wanted: Vec<_> = match &self.file {
            None => {
                let parameters = known.all.iter().filter(|one| one.can_be_set());
                parameters.map(|one| (one, None, None)).collect()
            }
            Some(file) => file::read(file, &known)?
                .into_iter()
                .map(|it| (it.one, Some(it.value), Some(it.line)))
                .collect(),
        };
        let mut all = Vec::new();
        for (one, described, line) in wanted {
            let failed = |error| format!("{}: {error}", one.place());
            let described = described.map_or_else(|| clients.initial(one), Ok);
            let described = described.map_err(failed)?;
            let present = clients.value(one).map_err(failed)?;
            all.extend(present.map(|present| Compared {
                one,
                described,
                present,
                line,
            }));
        }
        let compared = all.len();
        all.retain(|it| it.described != it.present);
        let sources = match &self.file {
            Some(file) => {
                let file = file.display().to_string();
                let source = |it: &Compared<'_>| Source {
                    file: Some(file.clone()),
                    line: it.line,
                    key: None,
                };
                all.iter().map(source).collect()
            }
            None => sources(application, Path::new(&running.status.file), &all),
        };
        self.show(&running.status.system, compared, &all, sources)?;
        Ok(all.is_empty())
    }

    fn show(
        &self,
        system: &str,
        compared: usize,
        all: &[Compared<'_>],
        sources: Vec<Source>,
    ) -> Result<(), AnyError> {
        let rows = all.iter().zip(sources);
        if self.how.json {
            let differences = rows.map(|(it, source)| Difference {
                processor: &it.one.member.name,
                owner: &it.one.owner,
                name: &it.one.name,
                unit: &it.one.entry.unit,
                described: it.one.of.json(it.described),
                present: it.one.of.json(it.present),
                file: source.file,
                line: source.line,
                key: source.key,
            });
            return print_json(&Answer {
                system,
                compared,
                differences: differences.collect(),
            });
        }
        if all.is_empty() {
            return print(format_args!(
                "{compared} parameters are compared; none differs\n"
            ));
        }
        let mut table = TextTable::new([
            ("processor", Left),
            ("in", Left),
            ("name", Left),
            ("described", Right),
            ("present", Right),
            ("unit", Left),
            ("described in", Left),
        ]);
        for (it, source) in rows {
            let line = source.line.map(|line| format!(":{line}"));
            let place = source.file.unwrap_or_default() + &line.unwrap_or_default();
            let key = source.key.unwrap_or_default();
            table.row([
                it.one.member.name.clone(),
                it.one.owner.to_string(),
                it.one.name.clone(),
                it.one.of.text(it.described),
                it.one.of.text(it.present),
                it.one.entry.unit.to_string(),
                format!("{place} {key}").trim().to_owned(),
            ]);
        }
        print(table)
    }
}

/// Finds the keys of the robot's configuration that say what parameters began with. A file that cannot be read, or has
/// none of them, says nothing.
fn sources(application: &dyn Application, system: &Path, all: &[Compared<'_>]) -> Vec<Source> {
    let description = SystemDescription::read(system, application).ok();
    let robot = description.and_then(|description| description.robot);
    let names: Vec<&str> = all.iter().map(|it| it.one.name.as_str()).collect();
    let keys = (robot.as_ref()).map(|robot| application.described_keys(robot, &names));
    let mut keys = keys.into_iter().flatten();
    let file = robot.map(|robot| robot.display().to_string());
    let source = |_: &Compared<'_>| match keys.next().flatten() {
        Some(DescribedKey { key, line }) => Source {
            file: file.clone(),
            line,
            key: Some(key),
        },
        None => Source::default(),
    };
    all.iter().map(source).collect()
}
