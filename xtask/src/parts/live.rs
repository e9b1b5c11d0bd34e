//! The live server, and a client that is not of this workspace.

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::parts::test;
use crate::tools::need_python;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let packages = "websockets==17.4 mcap==1.6.0 mcap-ros2-support==0.6.0";
    let python = need_python(context, "target/live", packages)?;
    test::build(context)?;
    let line = format!(
        "{python} system/cli/examples/viewer.py target/debug/utah-mit-hand \
         /servo_a/servo index.proximal.servo.kp"
    );
    let kept = context.command(&line).kept()?;
    Ok(Summary::of(format!("{kept} checks by a client in Python")))
}
