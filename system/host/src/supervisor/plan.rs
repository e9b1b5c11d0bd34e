//! Which programs a description starts, and with what.

use std::path::Path;
use std::time::Duration;

use condor_mbox::Processor as Number;

use super::UpError;
use super::files::SystemFiles;
use super::mailbox::SupervisorMailbox;
use super::member::{Member, Plan};
use crate::description::{OnFailure, ProgramEntry, SystemDescription};
use crate::error::NamedFileError;
use crate::launch::{ChildProcess, Launch, ProgramImage};
use crate::paths::{beside, find_program};
use crate::services;
use crate::system::SystemDirectory;
use condor_rt::linux::{Environment, FileRange};
use condor_rt::numbers::{EXTENSIONS, FILES, TERMINALS};

/// The time without a heartbeat after which a service counts as stalled.
const SERVICE_STALL: Duration = Duration::from_secs(10);

/// The services, then the processors in the order of the description.
pub(super) fn members(
    description: &SystemDescription,
    attended: bool,
    directory: &SystemDirectory,
    furniture: &SystemFiles,
    mailbox: &SupervisorMailbox<'_>,
) -> Result<Vec<Member>, UpError> {
    let system = System {
        own: std::env::current_exe().map_err(NamedFileError::at("find", "this program"))?,
        description,
        directory,
        clock: furniture.clock.as_ref(),
    };
    let mut members = Vec::new();
    let groups = || description.groups.iter().zip(&furniture.groups);
    let mut numbers = EXTENSIONS;
    for (entry, furnished) in groups() {
        if let (Some(name), Some(service)) = (entry.service, furnished.service()) {
            let number = numbers.next().ok_or_else(|| {
                let text = format!(
                    "there is no room for the service `{name}`: extensions can add {} services",
                    EXTENSIONS.len()
                );
                UpError::Prepare(text.into())
            })?;
            let arguments = [vec![services::WORD.into(), name.into()], service.arguments].concat();
            members.push(system.service(name, Number(number), arguments, service.launch)?);
        }
    }
    if let Some(files) = &description.files {
        members.push(system.own_service(services::FILES, FILES, files)?);
    }
    let settings = services::terminals::Settings::of(description, directory);
    members.push(system.own_service(services::TERMINALS, TERMINALS, &settings)?);

    for processor in &description.processors {
        let number = Number(processor.number);
        let plan = Plan {
            number,
            name: processor.name.clone(),
            program: match &processor.program {
                ProgramEntry::Own => "self".into(),
                ProgramEntry::File(path) => path.display().to_string(),
            },
            arguments: processor.arguments.clone(),
            on_failure: processor.on_failure,
            restarts: processor.restarts,
            stall: (processor.stall_seconds > 0)
                .then(|| Duration::from_secs(processor.stall_seconds.into())),
            kind: Some(processor.kind),
            runs_here: processor.runs_here,
        };
        let mut environment = system.environment(number);
        environment.bus.clone_from(&furniture.bus);
        environment.shared_memory.clone_from(&furniture.shared);
        let held = processor.hold_exceptions;
        environment.hold_exceptions =
            held.unwrap_or(attended && processor.on_failure == OnFailure::Restart);
        environment.float_exceptions = processor.float_exceptions;
        for (time, &us) in environment.work_ns.iter_mut().zip(&processor.loop_times_us) {
            *time = u64::from(us) * 1000;
        }
        let mut groups = groups();
        let (_, group) = groups
            .find(|(entry, _)| entry.kind == Some(processor.kind))
            .ok_or_else(|| {
                format!(
                    "this program knows no processors of kind `{}`",
                    processor.kind
                )
            })
            .map_err(|text| UpError::Prepare(text.into()))?;
        let launch = group.launch(number, &mut environment, mailbox.doorbell());
        let launch = launch.map_err(UpError::Prepare)?;
        let (file, arguments) = runs(&system.own, &processor.program, &processor.arguments);
        let image = ProgramImage::new(file, arguments, environment);
        members.push(Member::new(plan, &image, launch)?);
    }
    Ok(members)
}

/// The settings that all programs of a system are told.
struct System<'s> {
    own: std::path::PathBuf,
    description: &'s SystemDescription,
    directory: &'s SystemDirectory,
    clock: Option<&'s FileRange>,
}

impl System<'_> {
    /// A service of this crate, which gets its settings as an argument.
    fn own_service(
        &self,
        name: &str,
        number: Number,
        settings: &impl serde::Serialize,
    ) -> Result<Member, UpError> {
        let words = services::words(name, settings);
        let words = words.map_err(|error| UpError::Prepare(error.into()))?;
        self.service(name, number, words, Box::new(ChildProcess::new()))
    }

    fn service(
        &self,
        name: &str,
        number: Number,
        arguments: Vec<String>,
        launch: Box<dyn Launch>,
    ) -> Result<Member, UpError> {
        let image = ProgramImage::new(
            self.own.clone(),
            arguments.clone(),
            self.environment(number),
        );
        let plan = Plan {
            number,
            name: name.into(),
            program: "self".into(),
            arguments,
            on_failure: OnFailure::Restart,
            restarts: self.description.service_restarts,
            stall: Some(SERVICE_STALL),
            kind: None,
            runs_here: true,
        };
        Ok(Member::new(plan, &image, launch)?)
    }

    fn environment(&self, processor: Number) -> Environment {
        Environment {
            clock: self.clock.cloned(),
            ..Environment::new(
                self.directory.mailbox(),
                self.description.window_bytes,
                processor,
            )
        }
    }
}

/// The file that runs, and its arguments.
fn runs(
    own: &Path,
    program: &ProgramEntry,
    arguments: &[String],
) -> (std::path::PathBuf, Vec<String>) {
    match program {
        ProgramEntry::Own => {
            let arguments = [&["program".into()], arguments].concat();
            (own.into(), arguments)
        }
        ProgramEntry::File(path) => (path.clone(), arguments.to_vec()),
    }
}

/// Another program for a processor.
pub(super) fn reload(
    description: &SystemDescription,
    member: &Member,
    program: &str,
    arguments: &[String],
    own: &[&'static str],
) -> Result<ProgramImage, String> {
    let program = if !member.plan.runs_here {
        ProgramEntry::File(beside(&description.file, program))
    } else if program == "self" {
        let first = arguments.first().map_or("", String::as_str);
        if !own.contains(&first) {
            return Err(format!(
                "this binary contains no program `{first}`; it contains {}",
                own.join(", ")
            ));
        }
        ProgramEntry::Own
    } else {
        let path = find_program(&description.file, program);
        ProgramEntry::File(path?)
    };
    let own = std::env::current_exe().map_err(|error| error.to_string())?;
    let (file, arguments) = runs(&own, &program, arguments);
    let image = ProgramImage::new(file, arguments, member.environment.clone());
    // Told before the program that runs is stopped.
    let checked = member.launch().check(&image);
    checked.map_err(|error| error.to_string())?;
    Ok(image)
}
