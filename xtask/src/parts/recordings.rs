//! Recordings of the hand, read by programs of others.

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::parts::test;
use crate::tools::need_python;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let packages = "mcap-ros2-support==0.6.0 rosbags==0.11.9";
    let python = need_python(context, "target/recordings", packages)?;
    test::build(context)?;
    // Of the hand's own time.
    let seconds = if context.options.whole { 60 } else { 5 };
    let line = format!(
        "{python} examples/utah-mit-hand/tests/recordings.py target/debug/utah-mit-hand {seconds}"
    );
    let mut read = None;
    context.command(&line).watch(|line| {
        if line.contains(" samples of ") {
            read = Some(line.to_owned());
        }
    })?;
    let read = read.ok_or_else(|| format!("`{line}` read no samples"))?;
    Ok(Summary::of(format!(
        "rosbags and mcap-ros2-support read {read}"
    )))
}
