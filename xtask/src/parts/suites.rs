//! The test suites of file systems on what condor-fs serves, mounted by the program of `suites/`.

use std::process::Command;

use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;

/// The names of tests in `suites/pjdfstest.toml` are those of its version.
const TOOLS: &str = "fsx@0.3.2 pjdfstest@0.2.2";
/// Where they are installed, and the files are.
const PLACE: &str = "target/suites";

/// How long one run is; the whole makes one for each of so many seeds.
struct Extent {
    seeds: u64,
    /// Operations of fsx.
    operations: u64,
}

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let root = command(context, "id --user").read()?.trim() == "0";
    // What is mounted goes with the processes that see it, however they end.
    let alone = if root {
        "unshare --mount"
    } else {
        "unshare --map-root-user --mount"
    };
    let build = "cargo build --quiet --manifest-path suites/Cargo.toml --target-dir target";
    command(context, build).run()?;
    if let Some(problem) = unmountable(alone)? {
        return Ok(Summary::of("the mount, built").leaving_out(format!(
            "FSX AND PJDFSTEST, nothing may be mounted: {problem}"
        )));
    }
    let install = format!("cargo install --quiet --locked --debug --root {PLACE} {TOOLS}");
    command(context, &install)
        // Nobody debugs them.
        .env("CARGO_PROFILE_DEV_DEBUG", "0")
        .run()?;
    let extent = if context.whole {
        Extent {
            seeds: 10,
            operations: 10_000,
        }
    } else {
        Extent {
            seeds: 1,
            operations: 3_000,
        }
    };
    let mut kills = 0;
    for seed in 1..=extent.seeds {
        let mounted = format!("{alone} target/debug/condor-suites --seed {seed} {PLACE}");
        let fsx = format!(
            "{PLACE}/bin/fsx -f suites/fsx.toml -P {PLACE} -S {seed} -N {} {{}}/file",
            extent.operations
        );
        let pjdfstest = format!("{PLACE}/bin/pjdfstest -c suites/pjdfstest.toml -p {{}}");
        let suites = if root { &[fsx, pjdfstest][..] } else { &[fsx] };
        for suite in suites {
            command(context, &format!("{mounted} {suite}")).watch(|line| {
                kills += killed(line);
            })?;
        }
    }
    if kills == 0 {
        return Err("the server was never killed".into());
    }
    let fsx = extent.seeds * extent.operations;
    let summary = format!("{fsx} operations of fsx, {kills} kills of the server");
    Ok(if root {
        Summary::of(format!("pjdfstest {}×, {summary}", extent.seeds))
    } else {
        Summary::of(summary).leaving_out("PJDFSTEST, which only root can run")
    })
}

/// Why nothing can be mounted here; without a program of this workspace, whose faults are none of that.
fn unmountable(alone: &str) -> Result<Option<String>> {
    let mount = "exec 3<>/dev/fuse && mount -i -t fuse -o fd=3,rootmode=40000,user_id=0,group_id=0 \
                 condor /tmp";
    let mut words = alone.split(' ');
    let output = Command::new(words.next().unwrap_or_default())
        .args(words)
        .args(["sh", "-c", mount])
        .output()?;
    let told = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    Ok((!output.status.success()).then_some(told))
}

/// How often the server was killed, if that is what a line says.
fn killed(line: &str) -> u64 {
    let count = line.strip_prefix("the server was killed ");
    let count = count.and_then(|rest| rest.split(' ').next());
    count.and_then(|count| count.parse().ok()).unwrap_or(0)
}
