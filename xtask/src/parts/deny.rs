use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::tools::need_cargo_tool;

/// The workspace of the Python package, which brings `PyO3`.
const PYTHON: &str = "system/python";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_cargo_tool(context, "cargo-deny")?;
    let check = |what: &str| {
        let line = context.command(&format!("cargo deny check {what}"));
        line.run().and_then(|()| line.dir(PYTHON).run())
    };
    check("licenses bans sources")?;
    // A machine without a network cannot know of advisories, which says nothing about the crates.
    let fetch = context.command("timeout 30 cargo deny fetch db");
    if let Err(problem) = fetch.run() {
        return Ok(Summary::of("licenses, bans, sources")
            .leaving_out(format!("ADVISORIES, no database: {problem}")));
    }
    check("advisories")?;
    Ok(Summary::of("licenses, bans, sources, advisories"))
}
