use std::hint;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::programs::Program;
use crate::{programs, tests_run};

/// All packages with all features.
const ALL: &str = "--workspace --all-features";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    // The time that each unit takes to compile is reported in `target/cargo-timings`.
    let programs = programs::build(&context.command(&format!("{} --timings", build_line())))?;
    if let Some(rounds) = context.options.again {
        return again(&programs, rounds);
    }
    let passed = programs::run(&programs, &[])?;
    let documented = tests_run::count(&context.command(&format!("cargo test {ALL} --doc")))?;
    Ok(Summary::of(format!(
        "{passed} tests in {} programs, {documented} in documents",
        programs.len()
    )))
}

/// Runs the programs in each of `rounds` rounds, whatever fails in one, while each core has more to do than it can.
fn again(programs: &[Program], rounds: u32) -> Result<Summary> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let done = AtomicBool::new(false);
    let failed: Vec<_> = thread::scope(|scope| {
        for _ in 0..=cores {
            scope.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    hint::spin_loop();
                }
            });
        }
        let failed = (1..=rounds).filter_map(|round| {
            eprintln!("round {round} of {rounds}");
            let outcome = programs::run(programs, &[]);
            outcome.err().map(|error| format!("round {round}: {error}"))
        });
        let failed = failed.collect();
        done.store(true, Ordering::Relaxed);
        failed
    });
    if failed.is_empty() {
        let programs = programs.len();
        return Ok(Summary::of(format!(
            "{programs} programs {rounds} times beside {} busy loops",
            cores + 1
        )));
    }
    Err(failed.join("; ").into())
}

/// Builds all tests, examples and programs, and returns those that have tests. A part that runs one of them builds
/// them all: some alone would be compiled with features of their own.
pub(crate) fn build(context: &Context) -> Result<Vec<Program>> {
    programs::build(&context.command(&build_line()))
}

fn build_line() -> String {
    format!("cargo test {ALL} --no-run --message-format json-render-diagnostics")
}

#[cfg(test)]
mod tests {
    /// What a person types who reads README.md, to the letter.
    const COMMAND: &str = "cargo xtask test";

    #[test]
    fn is_the_command_of_the_readme() {
        let readme = include_str!("../../../README.md");
        assert!(readme.lines().any(|line| line.trim() == COMMAND));
    }

    #[test]
    fn is_the_command_of_ci() {
        let ci = include_str!("../../../.ci/run");
        assert!(ci.lines().any(|line| line.starts_with(COMMAND)));
    }
}
