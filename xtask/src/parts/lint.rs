use crate::Result;
use crate::context::{Context, OTHER_WORKSPACES};
use crate::firmware::{self, MACHINES, Machine};
use crate::parts::Summary;
use crate::parts::loom;
use crate::tools::{need_component, need_target};

/// `features` compiles the libraries with each feature; here the tests and examples are looked at. No feature is on by
/// default; that set is looked at with `--whole`.
const FEATURE_SETS: [&str; 2] = ["--all-features", ""];
/// The workspaces whose dependencies, some 300 crates each, would be compiled for this part alone; they are looked at with
/// `--whole`.
const LARGE: [&str; 2] = ["system/remote", "tests/bench"];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, None, "clippy")?;
    let sets = if context.options.whole { 2 } else { 1 };
    for set in FEATURE_SETS.iter().take(sets) {
        let line = format!("cargo clippy --workspace --all-targets {set} -- -D warnings");
        context.command(&line).run()?;
    }
    let models = loom::packages(context)?;
    let line = format!("cargo clippy {models} --lib --test loom -- -D warnings");
    loom::under_loom(context.command(&line)).run()?;
    let mut others = OTHER_WORKSPACES.to_vec();
    others.retain(|dir| context.options.whole || !LARGE.contains(dir));
    for dir in &others {
        context
            .command("cargo clippy --workspace --all-targets -- -D warnings")
            .dir(dir)
            .sharing_target()
            .run()?;
    }
    let mut groups = Vec::new();
    for machine in &MACHINES {
        let programs = Machine::selection(machine.programs);
        groups.push((machine.target, programs + " --lib --all-features"));
    }
    groups.push((firmware::HARTS_TARGET, "-p hand-exercise".into()));
    let counted = firmware::packages(&firmware::COUNTED);
    groups.push((firmware::COUNTED_TARGET, counted));
    let harts = firmware::packages(&firmware::HART_IMAGES);
    groups.push((firmware::HARTS_TARGET, harts + " -p qemu-virt-board"));
    for (target, selection) in &groups {
        need_target(context, target)?;
        let line = format!("cargo clippy {selection} --target {target} -- -D warnings");
        let line = context.command(&line).dir(firmware::WORKSPACE);
        line.sharing_target().run()?;
    }
    Ok(Summary::of(format!(
        "{sets} feature sets, loom models, {} groups of firmwares, {}",
        groups.len(),
        others.join(", ")
    )))
}
