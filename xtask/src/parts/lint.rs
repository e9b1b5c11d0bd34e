use std::fmt::Write as _;

use crate::Result;
use crate::context::Context;
use crate::firmware;
use crate::parts::Summary;
use crate::parts::loom;
use crate::tools::{need_component, need_target};

/// `features` compiles every combination of the libraries; here the tests and examples are looked at.
/// No feature is on by default.
const FEATURE_SETS: [&str; 2] = ["", "--all-features"];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "clippy")?;
    for set in FEATURE_SETS {
        let line = format!("cargo clippy --workspace --all-targets {set} -- -D warnings");
        context.command(&line).run()?;
    }
    let models = loom::packages(context)?;
    let line = format!("cargo clippy {models} --lib --test loom -- -D warnings");
    loom::under_loom(context.command(&line)).run()?;
    let others = context.other_workspaces();
    for dir in &others {
        context
            .command("cargo clippy --workspace --all-targets -- -D warnings")
            .dir(dir)
            // Most of what they depend on was looked at above.
            .env("CARGO_TARGET_DIR", "../target")
            .run()?;
    }
    let groups = firmware::groups();
    for group in &groups {
        let target = group[0].target;
        need_target(context, target)?;
        let mut line = String::from("cargo clippy -p checks -p machine");
        for firmware in group {
            let _ = write!(line, " -p {} -p {}", firmware.exercise, firmware.package);
        }
        let _ = write!(line, " --target {target} --all-features -- -D warnings");
        context
            .command(&line)
            .dir(firmware::WORKSPACE)
            .env("CARGO_TARGET_DIR", "../target")
            .run()?;
    }
    let alone = [
        (firmware::BENCH, firmware::BENCH_TARGET),
        (firmware::HARTS, firmware::HARTS_TARGET),
    ];
    for (workspace, target) in alone {
        need_target(context, target)?;
        let line = format!("cargo clippy --workspace --target {target} -- -D warnings");
        context
            .command(&line)
            .dir(workspace)
            .env("CARGO_TARGET_DIR", "../../target")
            .run()?;
    }
    let mut checked = format!(
        "{} feature sets, loom models, {} groups of firmwares",
        FEATURE_SETS.len(),
        groups.len() + alone.len()
    );
    for dir in others {
        checked += ", ";
        checked += dir;
    }
    Ok(Summary::of(checked))
}
