//! The page of the live server, in a browser while the hand grasps a ball.

use crate::Result;
use crate::context::Context;
use crate::parts::{Summary, test};
use crate::tools::need_debian;

/// The accessibility checks: one file, which is in no package of Debian.
const AXE: &str = "axe-core@4.10.3";
const PLACE: &str = "target/page";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    test::build(context)?;
    let kept = look(context, "target/debug/utah-mit-hand", PLACE)?;
    Ok(Summary::of(format!(
        "{kept} checks of the page in Chromium"
    )))
}

/// Checks the page of a program, and writes pictures of it into a directory; returns the number of checks.
pub(crate) fn look(context: &Context, hand: &str, pictures: &str) -> Result<u32> {
    for (package, program) in [
        ("chromium", "chromium"),
        ("chromium-driver", "chromedriver"),
        ("npm", "npm"),
        ("python3", "python3"),
    ] {
        need_debian(context, package, program)?;
    }
    std::fs::create_dir_all(context.root.join(PLACE))?;
    let axe = format!("{PLACE}/package/axe.min.js");
    if !context.root.join(&axe).is_file() {
        let pack = context.command(&format!(
            "npm pack --silent --pack-destination {PLACE} {AXE}"
        ));
        let archive = pack.read()?;
        let unpack = format!(
            "tar -xzf {PLACE}/{} -C {PLACE} package/axe.min.js",
            archive.trim()
        );
        context.command(&unpack).run()?;
    }
    let line = format!("python3 examples/utah-mit-hand/tests/page.py {hand} {axe} {pictures}");
    context.command(&line).kept()
}
