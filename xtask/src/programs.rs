//! Test programs: built in one call of cargo, and run by themselves, two at a time.

use std::cmp::Reverse;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::Value;

use crate::Result;
use crate::command::{Line, side_by_side, timed};
use crate::context::text;
use crate::tests_run::{failed_in, passed_in};

/// A program that has tests.
pub(crate) struct Program {
    pub package: String,
    /// The name of the test, or `lib` or the like for unit tests.
    pub name: String,
    pub path: PathBuf,
    /// The folder of the package.
    directory: PathBuf,
}

impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.package, self.name)
    }
}

/// Returns the name in an identifier such as `path+file:///…/system/host#condor-host@0.1.0`, or
/// `…/condor-mos#0.1.0` where the directory has the name.
fn package_in(id: &str) -> &str {
    let (path, version) = id.rsplit_once('#').unwrap_or((id, ""));
    match version.split_once('@') {
        Some((name, _)) => name,
        None => path.rsplit('/').next().unwrap_or(path),
    }
}

/// Has `cargo test --no-run` build programs, and returns them. `line` ends with
/// `--message-format json-render-diagnostics`.
///
/// # Errors
/// Returns an error if something does not compile, or if there is no test.
pub(crate) fn build(line: &Line) -> Result<Vec<Program>> {
    let messages = line.read()?;
    let mut programs = Vec::new();
    for message in messages.lines() {
        let Ok(message) = serde_json::from_str::<Value>(message) else {
            continue;
        };
        let (target, path) = (&message["target"], text(&message["executable"]));
        let kind = text(&target["kind"][0]);
        let is_test = kind == "test" || message["profile"]["test"] == true;
        // Examples are built to see that they compile.
        if path.is_empty() || !is_test || kind == "example" {
            continue;
        }
        let manifest = Path::new(text(&message["manifest_path"]));
        let directory = manifest.parent().unwrap_or(manifest);
        let package = package_in(text(&message["package_id"]));
        let name = text(&target["name"]);
        programs.push(Program {
            package: package.to_owned(),
            name: if kind == "test" { name } else { kind }.to_owned(),
            path: path.into(),
            directory: directory.to_owned(),
        });
    }
    if programs.is_empty() {
        return Err(format!("`{line}` built no test").into());
    }
    // The largest has the most to do, as a rule: nothing else should have to wait for its end.
    programs.sort_by_key(|program| {
        Reverse(std::fs::metadata(&program.path).map_or(0, |file| file.len()))
    });
    Ok(programs)
}

/// Runs programs, as many at a time as there are cores, with these arguments each, and returns the number
/// of tests that passed.
///
/// # Errors
/// Returns an error if a test fails; all programs are run.
pub(crate) fn run(programs: &[Program], arguments: &[&str]) -> Result<u32> {
    let done = AtomicUsize::new(0);
    let passed = side_by_side(programs, |program| {
        let output = timed(program, || {
            Command::new(&program.path)
                .args(arguments)
                .current_dir(&program.directory)
                .env("CARGO_MANIFEST_DIR", &program.directory)
                .stdin(Stdio::null())
                .output()
        })?;
        let printed = String::from_utf8_lossy(&output.stdout);
        let done = 1 + done.fetch_add(1, Ordering::Relaxed);
        let place = format!("[{done}/{}] {program}", programs.len());
        if !output.status.success() {
            let errors = String::from_utf8_lossy(&output.stderr);
            eprintln!("{place}: FAILED\n{printed}\n{errors}");
            let mut failed: Vec<&str> = printed.lines().filter_map(failed_in).collect();
            failed.sort_unstable();
            return Err(format!("{program}: {} {}", output.status, failed.join(", ")).into());
        }
        let counts: Vec<u32> = printed.lines().filter_map(passed_in).collect();
        // A program without libtest's harness is a test.
        let passed = if counts.is_empty() {
            1
        } else {
            counts.iter().sum()
        };
        eprintln!("{place}: {passed} passed");
        Ok(passed)
    })?;
    Ok(passed.iter().sum())
}
