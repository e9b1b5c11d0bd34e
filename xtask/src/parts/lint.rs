use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::firmware::{self, FIRMWARES};
use crate::outcome::Summary;
use crate::parts::loom;
use crate::tools::{need_component, need_debian, need_target};

/// `features` makes every combination of the libraries; here the tests and examples are looked at.
/// No feature is on by default.
const FEATURE_SETS: [&str; 2] = ["", "--all-features"];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "clippy")?;
    for set in FEATURE_SETS {
        let line = format!("cargo clippy --workspace --all-targets {set} -- -D warnings");
        command(context, &line).run()?;
    }
    let models = loom::models(context)?;
    for model in &models {
        let line = model.cargo("clippy", "-- -D warnings");
        loom::under_loom(command(context, &line)).run()?;
    }
    let others = context.other_workspaces();
    for dir in &others {
        if *dir == "fuzz" {
            need_debian(context, "g++", "c++", &[])?;
        }
        command(
            context,
            "cargo clippy --workspace --all-targets -- -D warnings",
        )
        .dir(dir)
        // Most of what they depend on was looked at above.
        .env("CARGO_TARGET_DIR", "../target")
        .run()?;
    }
    for firmware in &FIRMWARES {
        need_target(context, firmware.target)?;
        let line = format!(
            "cargo clippy -p checks -p {} -p {} --target {} --all-features -- -D warnings",
            firmware.exercise, firmware.package, firmware.target
        );
        command(context, &line).dir(firmware::WORKSPACE).run()?;
    }
    let alone = [
        (firmware::BENCH, firmware::BENCH_TARGET),
        (firmware::HARTS, firmware::HARTS_TARGET),
    ];
    for (workspace, target) in alone {
        need_target(context, target)?;
        let line = format!("cargo clippy --workspace --target {target} -- -D warnings");
        command(context, &line).dir(workspace).run()?;
    }
    let mut checked = format!(
        "{} feature sets, {} loom models, {} firmwares",
        FEATURE_SETS.len(),
        models.len(),
        FIRMWARES.len() + alone.len()
    );
    for dir in others {
        checked += ", ";
        checked += dir;
    }
    Ok(Summary::of(checked))
}
