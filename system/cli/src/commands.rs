//! One-shot commands that look at a running system, or send to it.
//!
//! Output is a table for people; with `--json` it is one JSON object, or one object per line if the
//! command goes on.

mod debug;
mod export;
mod expression;
pub(crate) mod number;
mod plot;
pub(crate) mod ps;
mod record;
pub(crate) mod running;
mod send;
mod sim;
pub(crate) mod top;
mod tty;
pub(crate) mod vars;
pub(crate) mod vectors;
mod view;

pub(crate) use debug::{Debug, Gdb};
pub(crate) use export::Export;
pub(crate) use expression::Print;
pub(crate) use plot::Plot;
pub(crate) use ps::Ps;
pub(crate) use record::Record;
pub(crate) use send::Send;
pub(crate) use sim::Sim;
pub(crate) use top::Top;
pub(crate) use tty::Tty;
pub(crate) use vars::Vars;
pub(crate) use vectors::Vectors;
pub(crate) use view::View;

use std::io::Write;

use clap::Args;
use serde::Serialize;

use condor_host::error::AnyError;
use condor_host::plain::plain_json;

/// Which of the running systems is meant.
#[derive(Debug, Args)]
pub(crate) struct SystemChoice {
    /// The name of the system; needed only if several are running
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
}

/// The options of all commands.
#[derive(Debug, Args)]
pub(crate) struct How {
    #[command(flatten)]
    which: SystemChoice,
    /// Prints JSON
    #[arg(long)]
    json: bool,
}

/// Prints `text`; returns an error if standard output is closed.
fn print(text: impl core::fmt::Display) -> Result<(), AnyError> {
    let mut out = std::io::stdout().lock();
    write!(out, "{text}")?;
    Ok(out.flush()?)
}

fn print_json(value: &impl Serialize) -> Result<(), AnyError> {
    print(format_args!("{}\n", plain_json(value)?))
}
