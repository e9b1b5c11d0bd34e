use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    command(context, "cargo doc --workspace --no-deps --all-features")
        .env("RUSTDOCFLAGS", "-D warnings")
        .run()?;
    Ok(Summary::of(format!(
        "{} packages",
        context.members()?.len()
    )))
}
