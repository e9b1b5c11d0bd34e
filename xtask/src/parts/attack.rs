//! The hand as processes, while they are killed and stopped, and the system goes down at random moments.

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let rounds = if context.options.whole { "100" } else { "10" };
    for clock in ["simulated", "real"] {
        context
            .command("cargo test --workspace --all-features --test queue")
            .env("CONDOR_ROUNDS", rounds)
            .env("CONDOR_CLOCK", clock)
            .run()?;
    }
    Ok(Summary::of(format!("{rounds} rounds by each clock")))
}
