use crate::Result;
use crate::context::{Context, OTHER_WORKSPACES};
use crate::firmware;
use crate::parts::Summary;
use crate::tools::need_component;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "rustfmt")?;
    let check = "cargo fmt --all --check";
    context.command(check).run()?;
    let others = OTHER_WORKSPACES.iter().chain([&firmware::WORKSPACE]);
    for dir in others.clone() {
        context.command(check).dir(dir).run()?;
    }
    Ok(Summary::of(format!("{} workspaces", 1 + others.count())))
}
