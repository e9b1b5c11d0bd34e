use crate::Result;
use crate::command::{Line, command};
use crate::context::{Context, IntegrationTest};
use crate::outcome::Summary;
use crate::tests_run;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let models = models(context)?;
    if models.is_empty() {
        return Err("no package has a test named loom, as in tests/spin_lock_loom.rs".into());
    }
    for model in &models {
        let line = model.cargo("test --release --no-run", "");
        under_loom(command(context, &line)).run()?;
    }
    // Most files have one long model, which keeps one core busy.
    let tests = models.iter().map(|model| {
        let line = model.cargo("test --release", "");
        under_loom(command(context, &line))
    });
    let passed = tests_run::count_together(&tests.collect::<Vec<_>>())?;
    Ok(Summary::of(format!(
        "{passed} models in {} files",
        models.len()
    )))
}

/// The integration tests that are empty unless loom's atomics are compiled in.
pub(crate) fn models(context: &Context) -> Result<Vec<IntegrationTest>> {
    context.integration_tests("loom")
}

/// Swaps in loom's atomics; in a directory of its own, for the flags concern every crate.
pub(crate) fn under_loom(line: Line) -> Line {
    line.env("RUSTFLAGS", "--cfg condor_loom")
        .env("CARGO_TARGET_DIR", "target/loom")
}
