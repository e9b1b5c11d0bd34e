use crate::Result;
use crate::context::{Context, list, text};
use crate::parts::Summary;
use crate::tools;

/// Builds the documentation of the workspace, and that of each package for the targets for which its
/// manifest asks for it.
pub(crate) fn run(context: &Context) -> Result<Summary> {
    let members = context.members()?;
    document(context, "--workspace")?;
    let mut others = 0;
    for package in &members {
        let targets = list(&package["metadata"]["docs"]["rs"]["targets"]);
        // The first is the one of the whole workspace.
        for target in targets.iter().skip(1).map(text) {
            tools::need_target(context, target)?;
            let name = text(&package["name"]);
            document(context, &format!("--package {name} --target {target}"))?;
            others += 1;
        }
    }
    let count = members.len();
    Ok(Summary::of(format!(
        "{count} packages, and {others} for other targets"
    )))
}

fn document(context: &Context, what: &str) -> Result<()> {
    context
        .command(&format!("cargo doc {what} --no-deps --all-features"))
        .env("RUSTDOCFLAGS", "-D warnings")
        .run()
}
