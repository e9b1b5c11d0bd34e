use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tests_run;

/// The members of the workspace, called as their directories are, in two runs: a program has one
/// implementation of critical sections, and what has loops in signals needs that of condor-mos.
const RUNS: [&[&str]; 2] = [
    &[
        "condor-dev",
        "condor-fs",
        "condor-hand",
        "condor-mbox",
        "condor-tty",
        "xtask",
    ],
    &[
        "condor-host",
        "condor-mos",
        "examples/drills",
        "examples/utah-mit-hand",
    ],
];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let mut passed = 0;
    for members in RUNS {
        let mut line = String::from("cargo test --all-features");
        for member in members {
            line += " -p ";
            line += member.rsplit('/').next().unwrap_or(member);
        }
        passed += tests_run::count(&command(context, &line))?;
    }
    Ok(Summary::of(format!("{passed} tests")))
}

#[cfg(test)]
mod tests {
    use super::RUNS;

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
        let mut members = RUNS.concat();
        members.sort_unstable();
        let members: Vec<_> = members.iter().map(|it| format!("\"{it}\"")).collect();
        let members = members.join(", ");
        assert!(manifest.contains(&format!("members = [{members}]")));
    }
}
