use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tools::need_cargo_tool;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_cargo_tool(context, "cargo-deny")?;
    command(context, "cargo deny check licenses bans sources").run()?;
    // A machine without a network cannot know of advisories, which says nothing about the crates.
    if let Err(problem) = command(context, "cargo deny fetch db").run() {
        return Ok(Summary::of("licenses, bans, sources")
            .leaving_out(format!("ADVISORIES, no database: {problem}")));
    }
    command(context, "cargo deny check advisories").run()?;
    Ok(Summary::of("licenses, bans, sources, advisories"))
}
