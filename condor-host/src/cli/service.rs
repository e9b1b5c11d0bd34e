//! `condor service`: what a supervisor starts.

use std::path::PathBuf;

use clap::Subcommand;
use condor_fs::server::Options;
use condor_mbox::Processor;

use crate::harts::Qemu;
use crate::services::machine;
use crate::services::terminals::{self, Sizes};
use crate::services::{ServiceError, files};

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
    /// Serves a machine of harts
    Machine {
        #[arg(long)]
        memory: PathBuf,
        #[arg(long)]
        link: PathBuf,
        #[arg(long)]
        qemu: PathBuf,
        #[arg(long)]
        monitor: PathBuf,
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        options: Vec<String>,
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
}

fn processor(text: &str) -> Result<(Processor, String), String> {
    let parts = text.split_once('=').ok_or("no NUMBER=NAME")?;
    let number = parts.0.parse().map_err(|_| "no number")?;
    Ok((Processor(number), parts.1.into()))
}

impl Service {
    pub(super) fn run(self) -> Result<(), ServiceError> {
        match self {
            Self::Files {
                root,
                read_only,
                quota_bytes,
                max_file_bytes,
            } => files::serve(
                &root,
                Options {
                    read_only,
                    quota_bytes,
                    max_file_bytes,
                    ..Options::default()
                },
            ),
            Self::Machine {
                memory,
                link,
                qemu: command,
                monitor,
                options,
            } => {
                let qemu = Qemu {
                    command,
                    monitor,
                    options,
                };
                machine::serve(&memory, &link, &qemu)
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
                terminals::serve(&directory, &processors, sizes)
            }
        }
    }
}
