//! The command line of `cargo xtask`.

use std::fmt::Write as _;

use clap::Parser;

use crate::context::Options;
use crate::parts::{PARTS, Part};

/// The checks of the workspace
#[derive(Parser)]
#[command(bin_name = "cargo xtask", after_help = list(), arg_required_else_help = true)]
pub(crate) struct Request {
    /// The parts to run; `verify` runs all, then prints a table of their times
    #[arg(value_name = "PART", value_parser = part, required = true)]
    pub parts: Vec<Selection>,
    /// With `verify`: does not repeat a part whose result of an earlier call is in target/checks
    #[arg(long)]
    pub rest: bool,
    #[command(flatten)]
    pub options: Options,
}

/// All parts, or one.
#[derive(Clone)]
pub(crate) enum Selection {
    Verify,
    Part(&'static Part),
}

fn list() -> String {
    let mut text = String::from("Parts, in the order of `verify`:");
    for part in PARTS {
        let alone = if part.in_verify {
            ""
        } else {
            " (not in `verify`)"
        };
        let _ = write!(text, "\n  {:10}{}{alone}", part.name, part.about);
    }
    text
}

fn part(name: &str) -> Result<Selection, String> {
    if name == "verify" {
        return Ok(Selection::Verify);
    }
    let found = PARTS.iter().find(|part| part.name == name);
    let part = found.ok_or_else(|| format!("there is no part `{name}`"))?;
    Ok(Selection::Part(part))
}
