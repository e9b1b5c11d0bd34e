//! The gateway: a program of another workspace that serves the system to other machines, as a service.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::AnyError;
use crate::extension::{Extension, ExtensionPart, Group, Service, StartingExtension};
use crate::launch::ChildProcess;
use crate::paths::{beside, find_program};
use crate::system::SystemDirectory;
use condor_toml::Spanned;

/// The service of the table `[gateway]`, which is always there.
pub(crate) const GATEWAY: &dyn Extension = &Gateway;
/// The name of its program.
const PROGRAM: &str = "condor-gateway";
/// The advice for an error that a program of the workspace `condor-remote` is not found: the commands that install it.
pub const INSTALL: &str = "install it from the source tree of Condor by `cargo install --path system/remote/gateway` \
                                  and `cargo install --path system/remote`";

struct Gateway;

/// The program, and its configuration.
#[derive(Clone, Debug)]
struct Serves {
    program: PathBuf,
    config: PathBuf,
}

impl Extension for Gateway {
    fn table(&self) -> Option<&'static str> {
        Some("gateway")
    }

    fn read(&self, found: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        let file = found.file;
        let keys = found.keys.as_mut()?;
        let table = keys.span();
        let config: Option<Spanned<String>> =
            keys.need("config", "the configuration of the gateway");
        let named: Option<Spanned<String>> = keys.get("program");
        let span = named.as_ref().map_or(table, Spanned::span);
        let name = named.map_or(PROGRAM.into(), Spanned::into_inner);
        let program = find_program(file, &name);
        let program = program.map_err(|problem| keys.wrong(&span, format!("{problem}; {INSTALL}")));
        let (config, program) = (config?, program.ok()?);
        let path = beside(file, config.as_ref());
        if !path.is_file() {
            keys.wrong(
                &config.span(),
                format!("there is no file {}", path.display()),
            );
            return None;
        }
        Some(Box::new(Serves {
            program,
            config: path,
        }))
    }

    fn serve(&self, arguments: &[String]) -> Result<(), AnyError> {
        let [program, config] = arguments else {
            return Err(
                "the service of a gateway takes two arguments: its program and its configuration"
                    .into(),
            );
        };
        // The gateway takes the place of this process, with its number and environment.
        let error = Command::new(Path::new(program)).arg(config).exec();
        Err(format!("cannot run {program}: {error}").into())
    }
}

impl Group for Serves {
    fn furnish(&self, _: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError> {
        Ok(Box::new(self.clone()))
    }
}

impl StartingExtension for Serves {
    fn service(&self) -> Option<Service> {
        let words = [&self.program, &self.config].map(|path| path.display().to_string());
        Some(Service {
            arguments: words.into(),
            launch: Box::new(ChildProcess::new()),
        })
    }
}
