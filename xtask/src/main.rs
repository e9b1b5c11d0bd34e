//! The checks of the workspace: `cargo xtask verify` makes them all, `cargo xtask PART…` some.

use std::process::ExitCode;

mod command;
mod context;
mod firmware;
mod image;
mod outcome;
mod parts;
mod programs;
mod request;
mod tests_run;
mod tools;

/// Whatever went wrong, in words for the person who reads the log.
type Result<T, E = Box<dyn std::error::Error>> = std::result::Result<T, E>;

fn main() -> ExitCode {
    let request = match request::from_args(std::env::args().skip(1)) {
        Ok(request) => request,
        Err(problem) => {
            eprintln!("xtask: {problem}\n\n{}", request::usage());
            return ExitCode::from(2);
        }
    };
    match request {
        request::Request::Help => {
            println!("{}", request::usage());
            ExitCode::SUCCESS
        }
        request::Request::Verify { rest, context } => outcome::verify(&context, rest),
        request::Request::Parts { parts, context } => outcome::each(&context, &parts),
    }
}
