//! The test suites of filesystems on what condor-fs serves, mounted by the program of `tests/suites`.

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::tools::is_root;

/// The names of tests in `tests/suites/pjdfstest.toml` are those of its version.
const TOOLS: &str = "fsx@0.3.2 pjdfstest@0.2.2";
/// The place where they are installed, and where the files are.
const PLACE: &str = "target/suites";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let root = is_root();
    // A mount goes with the processes that see it, however they end.
    let alone = if root {
        "unshare --mount"
    } else {
        "unshare --map-root-user --mount"
    };
    let build = "cargo build --quiet --manifest-path tests/suites/Cargo.toml --target-dir target";
    context.command(build).run()?;
    if let Err(problem) = context
        .command(&format!("{alone} tests/suites/may-mount"))
        .run()
    {
        return Ok(Summary::skipped(format!(
            "nothing can be mounted: {problem}"
        )));
    }
    let install = format!("cargo install --quiet --locked --debug --root {PLACE} {TOOLS}");
    context
        .command(&install)
        // Nobody debugs them.
        .env("CARGO_PROFILE_DEV_DEBUG", "0")
        .run()?;
    let (seeds, operations) = if context.options.whole {
        (10, 5_000)
    } else {
        (1, 3_000)
    };
    let mut kills = 0;
    for seed in 1..=seeds {
        let mounted = format!("{alone} target/debug/condor-suites --seed {seed} {PLACE}");
        let fsx = format!(
            "{PLACE}/bin/fsx -f tests/suites/fsx.toml -P {PLACE} -S {seed} -N {operations} {{}}/file"
        );
        let pjdfstest = format!("{PLACE}/bin/pjdfstest -c tests/suites/pjdfstest.toml -p {{}}");
        let suites = if root { &[fsx, pjdfstest][..] } else { &[fsx] };
        for suite in suites {
            context
                .command(&format!("{mounted} {suite}"))
                .watch(|line| {
                    kills += killed(line);
                })?;
        }
    }
    if kills == 0 {
        return Err("no run of a suite killed the file server, so no restart was tested".into());
    }
    let operations = seeds * operations;
    let summary = format!("{operations} operations of fsx, {kills} kills of the server");
    Ok(if root {
        Summary::of(format!("pjdfstest {seeds}×, {summary}"))
    } else {
        Summary::of(summary).leaving_out("PJDFSTEST, which only root can run")
    })
}

/// Returns the number of times that the server was killed, if a line says so.
fn killed(line: &str) -> u64 {
    let count = line.strip_prefix("the server was killed ");
    let count = count.and_then(|rest| rest.split(' ').next());
    count.and_then(|count| count.parse().ok()).unwrap_or(0)
}
