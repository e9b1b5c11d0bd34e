//! `condor` with a kind of processors and a service of its own.
//!
//! A processor of kind `"nice"` is a process that gives way to others; the service of the table `[adder]` answers
//! messages. Both work with a description such as
//!
//! ```toml
//! name = "extended"
//! window_bytes = 65536
//!
//! [adder]
//! amount = 7
//!
//! [[processors]]
//! number = 3
//! name = "polite"
//! kind = "nice"
//! level = 5
//! program = "program"
//! ```
//!
//! `cargo run -p condor-cli --example extension -- up FILE`

use std::process::ExitCode;
use std::time::Duration;

use condor_cli::{AnyError, Programs};
use condor_host::description::WholeNumber;
use condor_host::extension::{Extension, ExtensionPart, Group, Service, StartingExtension};
use condor_host::supervisor::{
    ChildProcess, EndSignals, Launch, LaunchError, ProgramImage, RunState, StopMethod,
};
use condor_host::system::{SystemDirectory, SystemWindows};
use condor_mbox::linux::LinuxDoorbell;
use condor_mbox::{Call, Messenger, Processor, SingleContext, Vector};
use condor_rt::linux::Environment;
use condor_rt::numbers::PROCESSORS;

/// The kind `"nice"`.
struct Nice;

/// The level of each processor, by number.
#[derive(Clone, Debug)]
struct Levels(Vec<(u8, i64)>);

impl Extension for Nice {
    fn kind(&self) -> Option<&'static str> {
        Some("nice")
    }

    fn runs_here(&self) -> bool {
        true
    }

    fn read(&self, found: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        let levels = found.processors.iter_mut().map(|processor| {
            let keys = &mut processor.keys;
            let level: Option<WholeNumber<_, 1, 19>> =
                keys.need("level", "how nice it is, 1 to 19");
            Some((processor.number?, level?.0))
        });
        // All are read, so that all mistakes are told.
        let levels: Vec<_> = levels.collect();
        let levels = levels.into_iter().collect::<Option<_>>()?;
        Some(Box::new(Levels(levels)))
    }
}

impl Group for Levels {
    fn furnish(&self, _: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError> {
        Ok(Box::new(self.clone()))
    }
}

impl StartingExtension for Levels {
    fn launch(
        &self,
        number: Processor,
        _: &mut Environment,
        _: LinuxDoorbell<PROCESSORS>,
    ) -> Result<Box<dyn Launch>, AnyError> {
        let mut levels = self.0.iter();
        let level = levels.find(|(one, _)| *one == number.0);
        let (_, level) = level.ok_or("the description has no such processor")?;
        let process = ChildProcess::new();
        Ok(Box::new(NiceProcess {
            process,
            level: *level,
        }))
    }
}

/// A process that the program `nice` starts.
struct NiceProcess {
    process: ChildProcess,
    level: i64,
}

impl Launch for NiceProcess {
    fn load(&mut self, image: &ProgramImage) -> Result<(), LaunchError> {
        let file = image.file.display().to_string();
        let before = ["-n".into(), self.level.to_string(), file];
        let arguments = [&before, image.arguments.as_slice()].concat();
        let environment = image.environment.clone();
        self.process.load(&ProgramImage::new(
            "/usr/bin/nice".into(),
            arguments,
            environment,
        ))
    }

    fn start(&mut self) -> Result<(), LaunchError> {
        self.process.start()
    }

    fn stop(&mut self, how: StopMethod) -> Result<(), LaunchError> {
        self.process.stop(how)
    }

    fn state(&mut self) -> RunState {
        self.process.state()
    }

    fn process(&self) -> Option<u32> {
        self.process.process()
    }
}

/// The service of the table `[adder]`: it adds an amount to what it is sent.
struct Adder;

#[derive(Clone, Debug)]
struct Amount(i64);

impl Extension for Adder {
    fn table(&self) -> Option<&'static str> {
        Some("adder")
    }

    fn read(&self, found: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        let keys = found.keys.as_mut()?;
        let amount: WholeNumber<_, 0, 100> = keys.need("amount", "what is added")?;
        Some(Box::new(Amount(amount.0)))
    }

    fn serve(&self, arguments: &[String]) -> Result<(), AnyError> {
        let amount = arguments.first().ok_or("the amount is missing")?;
        let amount: u32 = amount.parse()?;
        let mut signals = EndSignals::new()?;
        let environment = Environment::read()?;
        let system = SystemWindows::at(&environment.system, environment.window_bytes)?;
        let claim = system.claim(environment.processor)?;
        let add = |call: &Call<'_>| call.data().wrapping_add(amount);
        let mut mailbox = claim.mailbox_with(SingleContext::new())?;
        mailbox.set_vector(Vector(1), &add, "add")?;
        mailbox.join()?;
        while signals.taken() == 0 {
            mailbox.serve(Duration::from_millis(100))?;
        }
        Ok(mailbox.leave()?)
    }
}

impl Group for Amount {
    fn furnish(&self, _: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError> {
        Ok(Box::new(self.clone()))
    }
}

impl StartingExtension for Amount {
    fn service(&self) -> Option<Service> {
        Some(Service {
            arguments: vec![self.0.to_string()],
            launch: Box::new(ChildProcess::new()),
        })
    }
}

fn main() -> ExitCode {
    condor_cli::main(&Programs::new(&[]).with(&[&Nice, &Adder]))
}
