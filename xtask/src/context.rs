//! The place of the workspace, and its packages.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::Result;
use crate::command::Line;

/// The workspaces for the host besides the root, relative to it.
pub(crate) const OTHER_WORKSPACES: [&str; 4] =
    ["fuzz", "system/python", "system/remote", "tests/bench"];

/// The settings that every part gets.
pub(crate) struct Context {
    /// The directory of the root manifest.
    pub root: PathBuf,
    pub options: Options,
}

/// The options of single parts.
#[derive(clap::Args)]
pub(crate) struct Options {
    /// The time for which each fuzz target runs, in seconds
    #[arg(long, default_value_t = 60)]
    pub fuzz_seconds: u32,
    /// Makes `suites` and `full-disk` run in full, for ten and twenty minutes, instead of a short run of each
    #[arg(long)]
    pub whole: bool,
    /// Makes `test` run the programs of all tests N times beside busy loops, to find those that fail by chance
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub again: Option<u32>,
    /// Makes `imports` print packages in layers, from bottom to top: a package depends only on lower layers
    #[arg(long)]
    pub picture: bool,
    #[command(flatten)]
    pub words: Words,
}

/// The texts that `words` checks instead of the repository's, and whether it lowers the counts.
#[derive(clap::Args)]
pub(crate) struct Words {
    /// Makes `words` print all findings of the sources in FOLDER and their share, here or of another project; may be
    /// repeated
    #[arg(long, value_name = "FOLDER")]
    pub path: Vec<PathBuf>,
    /// With `--path`: checks only the first paragraphs of N public items of each folder
    #[arg(long, value_name = "N", requires = "path")]
    pub sample: Option<usize>,
    /// With `--sample`: the number from which items are drawn; another number draws others
    #[arg(long, value_name = "SEED", requires = "sample", default_value_t = 1)]
    pub seed: u64,
    /// Makes `words` write the new counts of findings to xtask/words.toml; refuses to raise one
    #[arg(long, conflicts_with = "path")]
    pub record: bool,
}

impl Context {
    pub(crate) fn new(options: Options) -> Self {
        let xtask = Path::new(env!("CARGO_MANIFEST_DIR"));
        Self {
            root: xtask.parent().unwrap_or(xtask).to_owned(),
            options,
        }
    }

    /// Makes a command whose words are separated by blanks, to run in the root of the workspace.
    pub(crate) fn command(&self, line: &str) -> Line {
        Line::new(line, &self.root)
    }

    /// Returns the directory in which cargo builds.
    pub(crate) fn target(&self) -> Result<PathBuf> {
        Ok(text(&self.metadata()?["target_directory"]).into())
    }

    /// Returns the packages of the root workspace, as `cargo metadata` describes them.
    pub(crate) fn members(&self) -> Result<Vec<Value>> {
        match self.metadata()?["packages"].take() {
            Value::Array(packages) => Ok(packages),
            _ => Err("cargo metadata lists no packages".into()),
        }
    }

    /// Returns the root workspace, as `cargo metadata` describes it.
    fn metadata(&self) -> Result<Value> {
        let line = self.command("cargo metadata --format-version 1 --no-deps");
        Ok(serde_json::from_str(&line.read()?)?)
    }

    /// Returns the packages of the root workspace that have an integration test of this name.
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

/// Returns the members of a JSON array; none if the value is something else.
pub(crate) fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// Returns a JSON string; an empty one if the value is something else.
pub(crate) fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}
