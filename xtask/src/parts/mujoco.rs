//! The controllers of the hand around a plant that is not of this workspace.

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::parts::test;
use crate::tools::need_python;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let python = need_python(context, "target/mujoco", "mujoco numpy")?;
    test::build(context)?;
    let line = format!(
        "target/debug/examples/closed_loop {python} condor-hand/examples/closed_loop/mujoco_hand.py"
    );
    let kept = context.command(&line).kept()?;
    Ok(Summary::of(format!("{kept} trials in closed loop")))
}
