//! The command line of `cargo xtask`.

use std::fmt::Write as _;

use crate::Result;
use crate::context::Context;
use crate::parts::{PARTS, Part};

/// What the person who called wants.
pub(crate) enum Request {
    Help,
    /// All parts, or those without a record of an earlier call.
    Verify {
        rest: bool,
        context: Context,
    },
    Parts {
        parts: Vec<&'static Part>,
        context: Context,
    },
}

/// Reads the arguments behind `cargo xtask`.
pub(crate) fn from_args(args: impl Iterator<Item = String>) -> Result<Request> {
    let mut args = args;
    let mut context = Context::new();
    let mut parts = Vec::new();
    let (mut verify, mut rest) = (false, false);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "help" | "-h" | "--help" => return Ok(Request::Help),
            "verify" => verify = true,
            "--rest" => rest = true,
            "--whole" => context.whole = true,
            "--fuzz-seconds" => context.fuzz_seconds = args.next().unwrap_or_default().parse()?,
            name => parts.push(part(name)?),
        }
    }
    match (verify, parts.is_empty()) {
        (true, true) => Ok(Request::Verify { rest, context }),
        (true, false) => Err("`verify` already makes every part".into()),
        (false, _) if rest => Err("--rest belongs to `verify`".into()),
        (false, true) => Ok(Request::Help),
        (false, false) => Ok(Request::Parts { parts, context }),
    }
}

/// The help text.
pub(crate) fn usage() -> String {
    let mut text = String::from(
        "cargo xtask verify [--rest]
    All parts in this order, then a table of what took how long, and a count. With --rest, a part of
    which target/checks has the record of an earlier call counts as that says.
cargo xtask PART…
    These parts only. --fuzz-seconds N: how long each fuzz target runs (60). --whole: `suites` and
    `full-disk` take ten and twenty minutes, instead of a short run of each.

parts:",
    );
    for part in PARTS {
        let alone = if part.in_verify {
            ""
        } else {
            " (not in `verify`)"
        };
        let _ = write!(text, "\n    {:10}{}{alone}", part.name, part.about);
    }
    text
}

fn part(name: &str) -> Result<&'static Part> {
    let found = PARTS.iter().find(|part| part.name == name);
    found.ok_or_else(|| format!("there is no part `{name}`").into())
}
