//! Where the workspace lies and what is in it.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::Result;
use crate::command::command;

/// What every part is given.
pub(crate) struct Context {
    /// The directory of the root manifest.
    pub root: PathBuf,
    /// How long each fuzz target runs, in seconds.
    pub fuzz_seconds: u32,
    /// Whether the suites run for as long as it takes to trust them.
    pub whole: bool,
}

/// A target of a package that `cargo test --test` can run.
pub(crate) struct IntegrationTest {
    pub package: String,
    pub name: String,
    pub required_features: Vec<String>,
}

impl IntegrationTest {
    /// The command that applies `verb` of cargo to this test alone.
    pub(crate) fn cargo(&self, verb: &str, rest: &str) -> String {
        let mut line = format!("cargo {verb} -p {} --test {}", self.package, self.name);
        if !self.required_features.is_empty() {
            line += " --features ";
            line += &self.required_features.join(",");
        }
        format!("{line} {rest}")
    }
}

impl Context {
    pub(crate) fn new() -> Self {
        let xtask = Path::new(env!("CARGO_MANIFEST_DIR"));
        Self {
            root: xtask.parent().unwrap_or(xtask).to_owned(),
            fuzz_seconds: 20,
            whole: false,
        }
    }

    /// The directories of the workspaces besides the root one that are here, relative to the root.
    pub(crate) fn other_workspaces(&self) -> Vec<&'static str> {
        ["bench", "fuzz", "suites"]
            .into_iter()
            .filter(|dir| self.root.join(dir).join("Cargo.toml").is_file())
            .collect()
    }

    /// The packages of the root workspace, as `cargo metadata` describes them.
    pub(crate) fn members(&self) -> Result<Vec<Value>> {
        self.packages("cargo metadata --format-version 1 --no-deps")
    }

    /// The packages of the root workspace and all that they need on this machine.
    pub(crate) fn members_and_dependencies(&self) -> Result<Vec<Value>> {
        let host = self.host()?;
        self.packages(&format!(
            "cargo metadata --format-version 1 --all-features --filter-platform {host}"
        ))
    }

    /// The integration tests of the root workspace whose names have `word` in them, as in `spin_lock_loom`.
    pub(crate) fn integration_tests(&self, word: &str) -> Result<Vec<IntegrationTest>> {
        let mut found = Vec::new();
        for package in self.members()? {
            for target in list(&package["targets"]) {
                let name = text(&target["name"]);
                if list(&target["kind"]).iter().any(|kind| kind == "test")
                    && name.split('_').any(|part| part == word)
                {
                    found.push(IntegrationTest {
                        package: text(&package["name"]).to_owned(),
                        name: name.to_owned(),
                        required_features: list(&target["required-features"])
                            .iter()
                            .map(|feature| text(feature).to_owned())
                            .collect(),
                    });
                }
            }
        }
        Ok(found)
    }

    fn packages(&self, metadata: &str) -> Result<Vec<Value>> {
        let mut metadata: Value = serde_json::from_str(&command(self, metadata).read()?)?;
        match metadata["packages"].take() {
            Value::Array(packages) => Ok(packages),
            _ => Err("cargo metadata lists no packages".into()),
        }
    }

    fn host(&self) -> Result<String> {
        let about = command(self, "rustc --version --verbose").read()?;
        let host = about.lines().find_map(|line| line.strip_prefix("host: "));
        Ok(host
            .ok_or("`rustc --version --verbose` names no host")?
            .to_owned())
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
