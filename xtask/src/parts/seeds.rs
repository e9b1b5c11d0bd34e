use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::tests_run;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    // What both workspaces use is compiled once.
    let tests = context
        .command("cargo test --test replay")
        .dir("fuzz")
        .env("CARGO_TARGET_DIR", "../target");
    Ok(Summary::of(format!(
        "{} targets",
        tests_run::count(&tests)?
    )))
}
