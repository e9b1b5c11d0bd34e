use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::tests_run;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let tests = context
        .command("cargo test --lib --bins")
        .dir("fuzz")
        .sharing_target();
    Ok(Summary::of(format!("{} tests", tests_run::count(&tests)?)))
}
