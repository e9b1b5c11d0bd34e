use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::firmware;
use crate::outcome::Summary;
use crate::tools::need_component;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "rustfmt")?;
    let check = "cargo fmt --all --check";
    command(context, check).run()?;
    let mut others = context.other_workspaces();
    others.extend([firmware::WORKSPACE, firmware::HARTS, firmware::BENCH]);
    for dir in &others {
        command(context, check).dir(dir).run()?;
    }
    Ok(Summary::of(format!("{} workspaces", 1 + others.len())))
}
