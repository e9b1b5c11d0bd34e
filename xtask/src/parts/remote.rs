//! The gateway and the clients of other machines, with the hand as processes.

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::tests_run;
use crate::tools::{need_cargo_tool, need_debian, need_python};

/// The workspace, which has what zenoh brings for itself.
const WORKSPACE: &str = "system/remote";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let command = |line: &str| {
        let command = context.command(line).dir(WORKSPACE);
        command.sharing_target()
    };
    let motions = if context.options.whole { "2000" } else { "40" };
    // Programs and tests in one build: built alone, programs would have dependencies with other features.
    command("cargo build --workspace --bins --tests").run()?;
    let tests = command("cargo test --workspace --lib --bins --test access");
    let passed = tests_run::count(&tests)?;
    let python = need_python(context, "target/remote", "eclipse-zenoh==1.10.2")?;
    // Network namespaces, and links that fail.
    need_debian(context, "iproute2", "tc")?;
    command("cargo test --workspace --test remote")
        .env(
            "CONDOR_REMOTE_PYTHON",
            context.root.join(python).display().to_string(),
        )
        .env(
            "CONDOR_REMOTE_PROGRAM",
            context
                .root
                .join("target/debug/condor-remote")
                .display()
                .to_string(),
        )
        .env("CONDOR_REMOTE_MOTIONS", motions)
        .run()?;
    if context.options.whole {
        command("cargo doc --workspace --no-deps --lib")
            .env("RUSTDOCFLAGS", "-D warnings")
            .run()?;
    }
    need_cargo_tool(context, "cargo-deny")?;
    command("cargo deny check licenses bans sources").run()?;
    Ok(Summary::of(format!(
        "{passed} tests, and twice {motions} motions while everything is killed"
    )))
}
