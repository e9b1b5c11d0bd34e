use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tests_run;

/// The members of the workspace, called as their directories are, and tested one by one: a program has
/// one implementation of critical sections, and the tests of condor-mos need another one than those of
/// the rest.
const PACKAGES: [&str; 9] = [
    "condor-dev",
    "condor-fs",
    "condor-hand",
    "condor-host",
    "condor-mbox",
    "condor-mos",
    "condor-tty",
    "examples/utah-mit-hand",
    "xtask",
];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let mut passed = 0;
    for member in PACKAGES {
        let package = member.rsplit('/').next().unwrap_or(member);
        let line = format!("cargo test -p {package} --all-features");
        passed += tests_run::count(&command(context, &line))?;
    }
    Ok(Summary::of(format!("{passed} tests")))
}

#[cfg(test)]
mod tests {
    use super::PACKAGES;

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
        assert!(ci.contains(&format!("if {COMMAND}; then")));
    }

    #[test]
    fn every_member_is_tested() {
        let manifest = include_str!("../../../Cargo.toml");
        let members = PACKAGES.map(|package| format!("\"{package}\"")).join(", ");
        assert!(manifest.contains(&format!("members = [{members}]")));
    }
}
