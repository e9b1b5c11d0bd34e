use crate::Result;
use crate::context::Context;
use crate::firmware;
use crate::parts::Summary;
use crate::tools::need_component;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "rustfmt")?;
    let check = "cargo fmt --all --check";
    context.command(check).run()?;
    let mut others = context.other_workspaces();
    others.push(firmware::WORKSPACE);
    for dir in &others {
        context.command(check).dir(dir).run()?;
    }
    Ok(Summary::of(format!("{} workspaces", 1 + others.len())))
}
