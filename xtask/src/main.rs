//! The checks of the workspace: `cargo xtask verify` makes them all, `cargo xtask PART…` some.

use std::process::ExitCode;

use clap::Parser as _;

use context::Context;
use request::{Request, Selection};

mod command;
mod context;
mod firmware;
mod image;
mod outcome;
mod parts;
mod programs;
mod request;
mod sources;
mod tests_run;
mod tools;

/// A result whose error is told in words for the person who reads the log.
type Result<T, E = Box<dyn std::error::Error>> = std::result::Result<T, E>;

fn main() -> ExitCode {
    let request = Request::parse();
    let context = Context::new(request.options);
    let mut parts = Vec::new();
    for asked in request.parts {
        match asked {
            Selection::Verify => return outcome::verify(&context, request.rest),
            Selection::Part(part) => parts.push(part),
        }
    }
    outcome::each(&context, &parts)
}
