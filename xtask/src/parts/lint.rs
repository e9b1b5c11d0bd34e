use crate::Result;
use crate::context::{Context, OTHER_WORKSPACES};
use crate::firmware;
use crate::parts::Summary;
use crate::parts::loom;
use crate::tools::{need_component, need_target};

/// `features` compiles every combination of the libraries; here the tests and examples are looked at.
/// No feature is on by default.
const FEATURE_SETS: [&str; 2] = ["", "--all-features"];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "clippy")?;
    for set in FEATURE_SETS {
        let line = format!("cargo clippy --workspace --all-targets {set} -- -D warnings");
        context.command(&line).run()?;
    }
    let models = loom::packages(context)?;
    let line = format!("cargo clippy {models} --lib --test loom -- -D warnings");
    loom::under_loom(context.command(&line)).run()?;
    for dir in OTHER_WORKSPACES {
        context
            .command("cargo clippy --workspace --all-targets -- -D warnings")
            .dir(dir)
            .sharing_target()
            .run()?;
    }
    let mut groups = Vec::new();
    for group in firmware::groups() {
        let mut packages = vec!["checks", "machine"];
        packages.extend(group.iter().flat_map(|one| [one.exercise, one.package]));
        groups.push((group[0].target, packages, "--all-features"));
    }
    groups.push((firmware::COUNTED_TARGET, firmware::COUNTED.to_vec(), ""));
    let mut harts = firmware::HART_IMAGES.to_vec();
    harts.push("qemu-virt-board");
    groups.push((firmware::HARTS_TARGET, harts, ""));
    for (target, packages, features) in &groups {
        need_target(context, target)?;
        let packages = packages.join(" -p ");
        let line =
            format!("cargo clippy -p {packages} --target {target} {features} -- -D warnings");
        let line = context.command(&line).dir(firmware::WORKSPACE);
        line.sharing_target().run()?;
    }
    Ok(Summary::of(format!(
        "{} feature sets, loom models, {} groups of firmwares, {}",
        FEATURE_SETS.len(),
        groups.len(),
        OTHER_WORKSPACES.join(", ")
    )))
}
