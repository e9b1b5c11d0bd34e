use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tests_run;

/// What a person types who reads README.md, to the letter.
const COMMAND: &str = "cargo test --workspace --all-features";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let passed = tests_run::count(&command(context, COMMAND))?;
    Ok(Summary::of(format!("{passed} tests")))
}

#[cfg(test)]
mod tests {
    use super::COMMAND;

    #[test]
    fn is_the_command_of_the_readme() {
        let readme = include_str!("../../../README.md");
        assert!(readme.lines().any(|line| line.trim() == COMMAND));
    }

    #[test]
    fn is_the_command_of_ci() {
        let ci = include_str!("../../../.ci/run");
        assert!(ci.contains(&format!("if {COMMAND}; then")));
    }
}
