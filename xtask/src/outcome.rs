//! Running parts and telling how they ended.

use std::process::ExitCode;
use std::time::Instant;

use crate::Result;
use crate::context::Context;
use crate::parts::{PARTS, Part};

/// What a part that passed has checked, and what it had to leave out.
pub(crate) struct Summary {
    checked: String,
    left_out: Option<String>,
}

impl Summary {
    /// Everything that the part stands for was checked.
    pub(crate) fn of(checked: impl Into<String>) -> Self {
        Self {
            checked: checked.into(),
            left_out: None,
        }
    }

    /// Something could not be checked on this machine, which the summary line says in capitals.
    pub(crate) fn leaving_out(self, what: impl Into<String>) -> Self {
        Self {
            left_out: Some(what.into()),
            ..self
        }
    }
}

/// A part that the caller has run, and how it ended.
pub(crate) struct Counted {
    pub part: &'static Part,
    pub passed: bool,
}

/// Runs these parts, each ending with its summary line.
pub(crate) fn each(context: &Context, parts: &[&Part]) -> ExitCode {
    let mut passed = true;
    for part in parts {
        let report = run(context, part);
        println!("{}", report.line);
        passed &= report.passed;
    }
    if passed {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Runs every part that the caller has not run; the last line is `N passed, N failed`.
pub(crate) fn verify(context: &Context, counted: &[Counted]) -> ExitCode {
    let mut reports = Vec::new();
    for part in PARTS {
        let by_caller = counted
            .iter()
            .find(|counted| counted.part.name == part.name);
        reports.push(if let Some(Counted { passed, .. }) = by_caller {
            let word = if *passed { "ok" } else { "FAILED" };
            let line = format!("xtask {}: {word} (run by the caller)", part.name);
            Report {
                passed: *passed,
                line,
            }
        } else {
            let report = run(context, part);
            println!("{}\n", report.line);
            report
        });
    }
    for report in &reports {
        println!("{}", report.line);
    }
    let passed = reports.iter().filter(|report| report.passed).count();
    let failed = reports.len() - passed;
    println!("\n{passed} passed, {failed} failed");
    if failed == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

struct Report {
    passed: bool,
    line: String,
}

fn run(context: &Context, part: &Part) -> Report {
    let start = Instant::now();
    let result: Result<Summary> = (part.run)(context);
    let seconds = start.elapsed().as_secs_f64();
    let name = part.name;
    match result {
        Ok(Summary { checked, left_out }) => {
            let left_out =
                left_out.map_or_else(String::new, |what| format!("; NOT CHECKED: {what}"));
            Report {
                passed: true,
                line: format!("xtask {name}: ok ({checked}{left_out}, {seconds:.1} s)"),
            }
        }
        Err(problem) => {
            // A summary is one line even if the problem was told in several.
            let problem = problem.to_string().replace('\n', "; ");
            Report {
                passed: false,
                line: format!("xtask {name}: FAILED ({problem}, {seconds:.1} s)"),
            }
        }
    }
}
