//! The command line of `cargo xtask`.

use std::fmt::Write as _;

use crate::Result;
use crate::context::Context;
use crate::outcome::Counted;
use crate::parts::{PARTS, Part};

/// What the person who called wants.
pub(crate) enum Request {
    Help,
    Verify {
        counted: Vec<Counted>,
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
    let mut counted = Vec::new();
    let mut parts = Vec::new();
    let mut verify = false;
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "help" | "-h" | "--help" => return Ok(Request::Help),
            "verify" => verify = true,
            "--passed" | "--failed" => counted.push(Counted {
                part: part(&args.next().unwrap_or_default())?,
                passed: arg == "--passed",
            }),
            "--whole" => context.whole = true,
            "--fuzz-seconds" => context.fuzz_seconds = args.next().unwrap_or_default().parse()?,
            name => parts.push(part(name)?),
        }
    }
    match (verify, parts.is_empty()) {
        (true, true) => Ok(Request::Verify { counted, context }),
        (true, false) => Err("`verify` already makes every part".into()),
        (false, true) => Ok(Request::Help),
        (false, false) if counted.is_empty() => Ok(Request::Parts { parts, context }),
        (false, false) => Err("--passed and --failed belong to `verify`".into()),
    }
}

/// The help text.
pub(crate) fn usage() -> String {
    let mut text = String::from(
        "cargo xtask verify [--passed PART | --failed PART]…
    All parts in this order, then all their summary lines and a count. A part named behind
    --passed or --failed was run by the caller: it is counted so and not run again.
cargo xtask PART…
    These parts only. --fuzz-seconds N: how long each fuzz target runs (20). --whole: `suites` and
    `full-disk` take ten and twenty minutes, instead of a short run of each.

parts:",
    );
    for part in PARTS {
        let _ = write!(text, "\n    {:10}{}", part.name, part.about);
    }
    text
}

fn part(name: &str) -> Result<&'static Part> {
    let found = PARTS.iter().find(|part| part.name == name);
    found.ok_or_else(|| format!("there is no part `{name}`").into())
}
