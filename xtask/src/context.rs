//! Where the workspace lies and what is in it.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::Result;
use crate::command::Line;

/// What every part is given.
pub(crate) struct Context {
    /// The directory of the root manifest.
    pub root: PathBuf,
    /// How long each fuzz target runs, in seconds.
    pub fuzz_seconds: u32,
    /// Whether the suites run for as long as it takes to trust them.
    pub whole: bool,
    /// How many times `test` runs the programs of the tests beside busy loops, instead of once without.
    pub again: Option<u32>,
    /// Whether `imports` prints the floors of the packages.
    pub picture: bool,
}

impl Context {
    pub(crate) fn new(fuzz_seconds: u32, whole: bool, again: Option<u32>, picture: bool) -> Self {
        let xtask = Path::new(env!("CARGO_MANIFEST_DIR"));
        Self {
            root: xtask.parent().unwrap_or(xtask).to_owned(),
            fuzz_seconds,
            whole,
            again,
            picture,
        }
    }

    /// A command whose words are separated by blanks, to run in the root of the workspace.
    pub(crate) fn command(&self, line: &str) -> Line {
        Line::new(line, &self.root)
    }

    /// The directories of the workspaces besides the root one that are here, relative to the root.
    pub(crate) fn other_workspaces(&self) -> Vec<&'static str> {
        ["fuzz", "system/python", "system/remote", "tests/bench"]
            .into_iter()
            .filter(|dir| self.root.join(dir).join("Cargo.toml").is_file())
            .collect()
    }

    /// The directory of what cargo builds.
    pub(crate) fn target(&self) -> Result<PathBuf> {
        Ok(text(&self.metadata()?["target_directory"]).into())
    }

    /// The packages of the root workspace, as `cargo metadata` describes them.
    pub(crate) fn members(&self) -> Result<Vec<Value>> {
        match self.metadata()?["packages"].take() {
            Value::Array(packages) => Ok(packages),
            _ => Err("cargo metadata lists no packages".into()),
        }
    }

    /// The root workspace, as `cargo metadata` describes it.
    fn metadata(&self) -> Result<Value> {
        let line = self.command("cargo metadata --format-version 1 --no-deps");
        Ok(serde_json::from_str(&line.read()?)?)
    }

    /// The packages of the root workspace that have an integration test of this name.
    pub(crate) fn packages_with_test(&self, test: &str) -> Result<Vec<String>> {
        let is_it =
            |target: &Value| text(&target["kind"][0]) == "test" && text(&target["name"]) == test;
        let members = self.members()?;
        let found = members
            .iter()
            .filter(|package| list(&package["targets"]).iter().any(is_it));
        Ok(found
            .map(|package| text(&package["name"]).to_owned())
            .collect())
    }
}

/// The members of a JSON array; none if it is something else.
pub(crate) fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// The JSON string; empty if it is something else.
pub(crate) fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}
