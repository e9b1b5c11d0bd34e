//! Bare-metal harts beside this machine: a whole system of them runs in QEMU.

use std::env;

use crate::Result;
use crate::command::{command, together};
use crate::context::Context;
use crate::firmware::{HARTS, HARTS_TARGET};
use crate::outcome::Summary;
use crate::tools::{need_debian, need_target};

/// How long the hand runs, and the harts whose time counts instructions.
const HAND_SECONDS: u32 = 10;
const EXACT_SECONDS: u32 = 5;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_target(context, HARTS_TARGET)?;
    // A newer qemu-utils, from a distribution's backports, keeps the package out.
    let qemu = need_debian(
        context,
        "qemu-system-misc",
        "qemu-system-riscv64",
        &["qemu-utils"],
    );
    if let Err(problem) = qemu {
        // Whoever has no QEMU can check all else.
        if env::var_os("CI").is_some() {
            return Err(problem);
        }
        return Ok(Summary::of("nothing").leaving_out(format!("ALL OF IT: {problem}")));
    }
    // The former ends with a long link on one core.
    together(&[
        command(context, "cargo build --release --locked")
            .dir(HARTS)
            .env("CARGO_TARGET_DIR", "target"),
        command(
            context,
            "cargo build --release --locked -p drills -p utah-mit-hand",
        ),
    ])?;
    let hand = format!(
        "target/release/utah-mit-hand up {HARTS}/hand.toml --headless --for {HAND_SECONDS}s"
    );
    command(context, &hand).run()?;
    let images = format!("{HARTS}/target/{HARTS_TARGET}/release");
    let exact =
        format!("target/release/drills exact {images}/monitor {images}/drill {EXACT_SECONDS}");
    command(context, &exact).run()?;
    let stack = format!("target/release/drills stack {images}/monitor {images}/drill");
    command(context, &stack).run()?;
    // Both, as above: what is built once is used again.
    let tests =
        "cargo test --release --locked -p drills -p utah-mit-hand --test harts -- --ignored";
    let mut passed = 0;
    command(context, tests).watch(|line| passed += u32::from(line.ends_with("... ok")))?;
    if passed == 0 {
        return Err(format!("`{tests}` made no test").into());
    }
    Ok(Summary::of(format!(
        "the hand on harts for {HAND_SECONDS} s, {EXACT_SECONDS} s of exact stress, {passed} tests"
    )))
}
