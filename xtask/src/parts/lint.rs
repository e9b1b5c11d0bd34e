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
    for (dir, target) in [
        (firmware::HARTS, firmware::HARTS_TARGET),
        (firmware::BENCH, firmware::BENCH_TARGET),
    ] {
        need_target(context, target)?;
        let line = format!("cargo clippy --workspace --target {target} -- -D warnings");
        command(context, &line).dir(dir).run()?;
    }
    let mut checked = format!(
        "{} feature sets, {} loom models, {} firmwares",
        FEATURE_SETS.len(),
        models.len(),
        FIRMWARES.len() + 2
    );
    for dir in others {
        checked += ", ";
        checked += dir;
    }
    Ok(Summary::of(checked))
}
