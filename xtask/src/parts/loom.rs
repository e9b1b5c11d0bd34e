use crate::Result;
use crate::command::Line;
use crate::context::Context;
use crate::parts::Summary;
use crate::programs;

/// The packages that have models among their unit tests.
const WITH_UNIT_MODELS: [&str; 2] = ["condor-fs", "condor-mbox"];
/// A part of the names of those models.
const UNIT_MODELS: &str = "loom_models";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let build = |what: &str| {
        let line = format!(
            "cargo test --release {what} --no-run --message-format json-render-diagnostics"
        );
        programs::build(&under_loom(context.command(&line)))
    };
    let models = build(&format!("{} --test loom", packages(context)?))?;
    let mut passed = programs::run(&models, &[])?;
    for package in WITH_UNIT_MODELS {
        let unit = programs::run(&build(&format!("-p {package} --lib"))?, &[UNIT_MODELS])?;
        if unit == 0 {
            return Err(format!("{package} has no unit test `{UNIT_MODELS}`").into());
        }
        passed += unit;
    }
    Ok(Summary::of(format!(
        "{passed} models in {} packages",
        models.len()
    )))
}

/// Returns the packages that have a test named `loom`, as arguments of cargo.
pub(crate) fn packages(context: &Context) -> Result<String> {
    let packages = context.packages_with_test("loom")?;
    if packages.is_empty() {
        return Err("no package has a test named `loom`".into());
    }
    Ok(format!("-p {}", packages.join(" -p ")))
}

/// Swaps in loom's atomics; in a directory of its own, for the flags concern every crate.
pub(crate) fn under_loom(line: Line) -> Line {
    line.env("RUSTFLAGS", "--cfg condor_loom")
        .env("CARGO_TARGET_DIR", "target/loom")
}
