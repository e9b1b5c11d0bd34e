//! The services of a running system, each in a process of its own.
//!
//! A service may be killed at any moment: the supervisor restarts it, and it continues.

mod files;
pub mod terminals;

use std::time::Duration;

use condor_mbox::linux::{Claim, SystemError};
use condor_mbox::{MailboxError, Processor};

use crate::application::Application;
use crate::error::{AnyError, NamedFileError};
use crate::gateway::GATEWAY;
use crate::system::SystemWindows;
use condor_rt::linux::{Environment, MappedPage, ProcessError};
use condor_rt::numbers::PROCESSORS;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The first argument with which the supervisor starts its own binary to run a service. Pass the arguments after it to
/// [`run`].
pub const WORD: &str = "service";
/// The names of the services that every system may have.
pub(crate) const FILES: &str = "files";
pub(crate) const TERMINALS: &str = "terminals";

/// The longest wait for a number whose previous service is exiting.
const SUCCESSION: Duration = Duration::from_secs(5);

/// The reason why a service could not start, or has ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// The environment of the process does not describe a service: a supervisor did not start it.
    #[error(transparent)]
    Environment(#[from] ProcessError),
    /// The processors' shared memory (the windows) cannot be opened.
    #[error(transparent)]
    Windows(#[from] SystemError),
    /// The mailbox of the service returned this error.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
    /// The file server returned this error.
    #[error(transparent)]
    Files(#[from] condor_fs::server::ServerError),
    /// An operation on one of its files failed.
    #[error(transparent)]
    File(#[from] NamedFileError),
    /// Signals could not be handled, or the wait for events failed.
    #[error("cannot wait for events: {0}")]
    Events(std::io::Error),
}

/// Runs a service until SIGTERM. `words` are the arguments of this process after [`WORD`]: the name of the service, and
/// its own arguments. A binary with an [`Application`] calls this function if its first argument is [`WORD`].
///
/// # Errors
/// Returns [`ServiceError`] if the file or the terminal service fails; the extension's error if its service
/// fails; an error that names the mistake if the words are wrong.
pub fn run(words: &[String], application: &dyn Application) -> Result<(), AnyError> {
    let (name, arguments) = words
        .split_first()
        .ok_or("the name of the service is missing")?;
    match name.as_str() {
        FILES => Ok(files::serve(&settings(arguments)?)?),
        TERMINALS => Ok(terminals::serve(&settings(arguments)?)?),
        _ => {
            let mut extensions = application.extensions().iter().chain([&GATEWAY]);
            let extension = extensions.find(|it| it.table() == Some(name.as_str()));
            let extension = extension.ok_or_else(|| format!("there is no service `{name}`"))?;
            extension.serve(arguments)
        }
    }
}

/// The words with which the supervisor starts its own program as a service with settings.
pub(crate) fn words(name: &str, settings: &impl Serialize) -> serde_json::Result<Vec<String>> {
    let settings = serde_json::to_string(settings)?;
    Ok(vec![WORD.into(), name.into(), settings])
}

/// Reads the settings that [`words`] wrote after the name.
fn settings<T: DeserializeOwned>(arguments: &[String]) -> Result<T, AnyError> {
    let [settings] = arguments else {
        return Err(
            "a service takes one argument, its settings in JSON; `condor up` starts services and passes it".into(),
        );
    };
    Ok(serde_json::from_str(settings)?)
}

/// Claims `number` of the system that the environment names, and opens the page of its simulated
/// clock, if it has one.
fn claim(number: Processor) -> Result<(Claim<PROCESSORS>, Option<MappedPage>), ServiceError> {
    let environment = Environment::read()?;
    let system = SystemWindows::at(environment.system, environment.window_bytes)?;
    let page = environment.clock.as_ref().map(MappedPage::open);
    Ok((system.claim_within(number, SUCCESSION)?, page.transpose()?))
}
