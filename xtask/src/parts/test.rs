use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::{programs, tests_run};

/// All packages with all features.
const ALL: &str = "--workspace --all-features";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let programs = programs::build(&context.command(&build_line()))?;
    let passed = programs::run(&programs, &[])?;
    let documented = tests_run::count(&context.command(&format!("cargo test {ALL} --doc")))?;
    Ok(Summary::of(format!(
        "{passed} tests in {} programs, {documented} in documents",
        programs.len()
    )))
}

/// Builds all tests, examples and programs. Whoever runs one builds them all by this line: a part of them would
/// be compiled with features of its own.
pub(crate) fn build_line() -> String {
    format!("cargo test {ALL} --no-run --message-format json-render-diagnostics")
}

#[cfg(test)]
mod tests {
    /// What a person types who reads README.md, to the letter.
    const COMMAND: &str = "cargo xtask test";

    #[test]
    fn is_the_command_of_the_readme() {
        let readme = include_str!("../../../README.md");
        assert!(readme.lines().any(|line| line.trim() == COMMAND));
    }

    #[test]
    fn is_the_command_of_ci() {
        let ci = include_str!("../../../.ci/run");
        assert!(ci.lines().any(|line| line.starts_with(COMMAND)));
    }
}
