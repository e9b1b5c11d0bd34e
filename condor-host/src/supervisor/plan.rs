//! Which programs a description starts, and with what.

use std::time::Duration;

use condor_mbox::Processor as Number;

use super::UpError;
use super::eye::Eye;
use super::hart::{self, Hart, Machine, Power};
use super::launch::{Image, Launch, LaunchError};
use super::member::{Member, Plan};
use super::process::Process;
use crate::control;
use crate::description::{Description, Kind, OnFailure, Processor, Program, beside, find_program};
use crate::harts::{self, MachineMemory};
use crate::services;
use crate::system::Directory;
use condor_rt::linux::{self, BusFile, Environment};
use condor_rt::numbers::{FILES, MACHINE, TERMINALS};

/// How long the heart of a service may stand still.
const SERVICE_STALL: Duration = Duration::from_secs(10);

/// The services, then the processors in the order of the description.
pub(super) fn members(
    description: &Description,
    directory: &Directory,
    memory: Option<&MachineMemory>,
    eye: &Eye,
) -> Result<Vec<Member>, UpError> {
    let own = std::env::current_exe().map_err(UpError::at("find", "this program".as_ref()))?;
    let mut members = Vec::new();
    let power = Power::new();
    if let (Some(machine), Some(memory)) = (&description.machine, memory) {
        let arguments = services::machine::arguments(machine, directory);
        let launch = Machine::new(memory.clone(), power.clone());
        let launch = Box::new(launch);
        let (place, it) = ((description, directory), (MACHINE, "machine"));
        members.push(service(it, &own, arguments, launch, place)?);
    }
    if let Some(files) = &description.files {
        let arguments = services::files::arguments(files);
        let (place, it) = ((description, directory), (FILES, "files"));
        let launch = Box::new(Process::new());
        members.push(service(it, &own, arguments, launch, place)?);
    }
    let arguments = services::terminals::arguments(description, directory);
    let (place, it) = ((description, directory), (TERMINALS, "terminals"));
    let launch = Box::new(Process::new());
    members.push(service(it, &own, arguments, launch, place)?);
    for processor in &description.processors {
        let plan = Plan {
            number: Number(processor.number),
            name: processor.name.clone(),
            program: match &processor.program {
                Program::Own => "self".into(),
                Program::File(path) => path.display().to_string(),
            },
            arguments: processor.arguments.clone(),
            on_failure: processor.on_failure,
            restarts: processor.restarts,
            stall: (processor.stall_seconds > 0)
                .then(|| Duration::from_secs(processor.stall_seconds.into())),
            kind: match processor.kind {
                Kind::Process => control::Kind::Process,
                Kind::Hart(_) => control::Kind::Hart,
            },
        };
        let image = image(
            processor,
            &processor.program,
            &processor.arguments,
            description,
            directory,
        )
        .map_err(UpError::at("find", "this program".as_ref()))?;
        let launch: Box<dyn Launch> = match processor.kind {
            Kind::Process => Box::new(Process::new()),
            Kind::Hart(hart) => {
                let memory = memory.cloned().ok_or(LaunchError::Off { hart })?;
                let doorbell = eye.doorbell();
                Box::new(Hart::new(memory, hart, doorbell, power.clone())?)
            }
        };
        members.push(Member::new(plan, &image, launch)?);
    }
    Ok(members)
}

fn service(
    (number, name): (Number, &str),
    own: &std::path::Path,
    arguments: Vec<String>,
    launch: Box<dyn Launch>,
    (description, directory): (&Description, &Directory),
) -> Result<Member, UpError> {
    let environment = basics(number.0, description, directory);
    let image = Image::new(own.into(), arguments.clone(), environment);
    let plan = Plan {
        number,
        name: name.into(),
        program: "self".into(),
        arguments,
        on_failure: OnFailure::Restart,
        restarts: description.service_restarts,
        stall: Some(SERVICE_STALL),
        kind: control::Kind::Service,
    };
    Ok(Member::new(plan, &image, launch)?)
}

fn image(
    processor: &Processor,
    program: &Program,
    arguments: &[String],
    description: &Description,
    directory: &Directory,
) -> std::io::Result<Image> {
    let environment = Environment {
        bus: bus(description, directory),
        loops: processor.loops,
        cpu: processor.cpu.map(|cpu| cpu as usize),
        priority: processor.priority,
        ..basics(processor.number, description, directory)
    };
    let (file, arguments) = match program {
        Program::Own => {
            let mut all = vec!["program".into()];
            all.extend_from_slice(arguments);
            (std::env::current_exe()?, all)
        }
        Program::File(path) => (path.clone(), arguments.to_vec()),
    };
    Ok(Image::new(file, arguments, environment))
}

/// Where the bus is: in the memory of the machine, if there is one.
fn bus(description: &Description, directory: &Directory) -> Option<BusFile> {
    match description.map() {
        Some(map) => harts::bus(&directory.memory(), &map.ok()?),
        None => (description.bus.as_ref()).map(|_| BusFile::whole(directory.bus())),
    }
}

/// What every process of the system is told.
fn basics(number: u8, description: &Description, directory: &Directory) -> Environment {
    Environment {
        system: directory.mailbox(),
        window_bytes: description.window_bytes,
        processor: Number(number),
        bus: None,
        loops: linux::Loops::default(),
        cpu: None,
        priority: None,
    }
}

/// Another program for a processor.
pub(super) fn reload(
    description: &Description,
    directory: &Directory,
    number: u8,
    program: &str,
    arguments: &[String],
    own: &[&'static str],
) -> Result<Image, String> {
    let mut processors = description.processors.iter();
    let Some(processor) = processors.find(|processor| processor.number == number) else {
        return Err(format!("there is no processor {number}"));
    };
    if let Kind::Hart(hart) = processor.kind {
        let file = beside(&description.file, program);
        let map = description.map().and_then(Result::ok);
        // Told before the program that runs is stopped.
        let checked = map.map_or(Ok(()), |map| hart::read(&file, &map, hart).map(drop));
        let checked = checked.and_then(|()| hart::flat(arguments).map(drop));
        checked.map_err(|error| error.to_string())?;
        let program = Program::File(file);
        return image(processor, &program, arguments, description, directory)
            .map_err(|error| error.to_string());
    }
    let program = if program == "self" {
        let first = arguments.first().map_or("", String::as_str);
        if !own.contains(&first) {
            return Err(format!("`{first}` is none of {}", own.join(", ")));
        }
        Program::Own
    } else {
        let path = find_program(&description.file, program);
        Program::File(path.map_err(|problem| problem.to_string())?)
    };
    image(processor, &program, arguments, description, directory).map_err(|error| error.to_string())
}
