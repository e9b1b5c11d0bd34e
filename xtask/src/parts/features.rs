use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tools::{need_cargo_tool, need_component};

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_cargo_tool(context, "cargo-hack")?;
    need_component(context, None, "clippy")?;
    // What is wrong between features is wrong between two of them, or with all, which `lint` looks at.
    // `default` is empty in every crate and `std` comes with others: each combination would be checked
    // twice. The sets of the examples are those that `lint`, `no-std` and `riscv` build.
    let powerset = "cargo hack clippy --feature-powerset --depth 2 --skip default,std --workspace \
                    --exclude xtask --exclude drills --exclude utah-mit-hand";
    let combinations = command(context, &format!("{powerset} --print-command-list")).read()?;
    let combinations = combinations
        .lines()
        .filter(|line| line.contains("clippy"))
        .count();
    if combinations == 0 {
        return Err(format!("`{powerset}` has no combination to check").into());
    }
    command(context, &format!("{powerset} -- -D warnings")).run()?;
    Ok(Summary::of(format!("{combinations} combinations")))
}
