//! `condor service`: what a supervisor starts.

use std::path::PathBuf;

use clap::Subcommand;
use condor_fs::server::Options;
use condor_mbox::Processor;

use super::{AnyError, Application};
use crate::gateway::GATEWAY;
use crate::services::files;
use crate::services::terminals::{self, Sizes};

#[derive(Debug, Subcommand)]
pub(super) enum Service {
    /// Serves a directory to the programs
    Files {
        root: PathBuf,
        #[arg(long)]
        read_only: bool,
        #[arg(long)]
        quota_bytes: Option<u64>,
        #[arg(long)]
        max_file_bytes: Option<u64>,
    },
    /// Serves the terminals of the programs
    Terminals {
        directory: PathBuf,
        #[arg(value_parser = processor, value_name = "NUMBER=NAME")]
        processors: Vec<(Processor, String)>,
        #[arg(long)]
        replay_bytes: u64,
        #[arg(long)]
        log_bytes: u64,
    },
    /// Runs the service of an extension
    #[command(external_subcommand)]
    Other(Vec<String>),
}

fn processor(text: &str) -> Result<(Processor, String), String> {
    let parts = text.split_once('=').ok_or("expected NUMBER=NAME")?;
    let number = parts.0.parse().map_err(|_| "expected NUMBER=NAME")?;
    Ok((Processor(number), parts.1.into()))
}

impl Service {
    pub(super) fn run(self, application: &dyn Application) -> Result<(), AnyError> {
        match self {
            Self::Files {
                root,
                read_only,
                quota_bytes,
                max_file_bytes,
            } => {
                let options = Options {
                    read_only,
                    quota_bytes,
                    max_file_bytes,
                    ..Options::default()
                };
                files::serve(&root, options)?;
            }
            Self::Terminals {
                directory,
                processors,
                replay_bytes,
                log_bytes,
            } => {
                let sizes = Sizes {
                    replay_bytes,
                    log_bytes,
                };
                terminals::serve(&directory, &processors, sizes)?;
            }
            Self::Other(words) => {
                let (name, arguments) = words.split_first().ok_or("no service is named")?;
                let mut extensions = application.extensions().iter().chain([&GATEWAY]);
                let extension = extensions.find(|it| it.table() == Some(name.as_str()));
                let extension = extension.ok_or_else(|| format!("there is no service `{name}`"))?;
                extension.serve(arguments)?;
            }
        }
        Ok(())
    }
}
