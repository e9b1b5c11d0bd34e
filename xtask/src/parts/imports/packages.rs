//! [`Packages`]: the packages of all workspaces of the repository.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{Modules, reaches};
use crate::Result;
use crate::command::Line;
use crate::context::{list, text};
use crate::sources;

/// The names of the folders that lead to a package, from the root of the repository.
type Directory = Vec<String>;

/// The packages of all workspaces.
pub(super) struct Packages {
    pub(super) all: BTreeMap<Directory, Package>,
    pub(super) workspaces: usize,
}

/// A package, without its tests, examples and benchmarks.
pub(super) struct Package {
    pub(super) name: String,
    /// The modules of its library and of each of its programs.
    pub(super) crates: Vec<Modules>,
    /// Lines of their files that are neither empty nor a comment.
    pub(super) lines: usize,
    files: usize,
    /// The sources that lie outside of its directory, each in a line; here with those of its tests and all
    /// else.
    pub(super) reaches: Vec<String>,
    /// The packages that its normal dependencies are.
    dependencies: BTreeSet<Directory>,
}

impl Packages {
    /// Reads the packages of all workspaces below `root`.
    pub(super) fn read(root: &Path) -> Result<Self> {
        let root = root.canonicalize()?;
        let (mut all, mut workspaces) = (BTreeMap::new(), 0);
        for manifest in sources::files(&root, &|_| false)? {
            if !manifest.ends_with("Cargo.toml") || !has_workspace(&fs::read_to_string(&manifest)?)
            {
                continue;
            }
            workspaces += 1;
            let line = format!(
                "cargo metadata --format-version 1 --no-deps --manifest-path {}",
                manifest.strip_prefix(&root)?.display()
            );
            let metadata: Value = serde_json::from_str(&Line::new(&line, &root).read()?)?;
            for package in list(&metadata["packages"]) {
                let manifest = Path::new(text(&package["manifest_path"]));
                let directory = manifest.parent().unwrap_or(manifest);
                all.insert(place(&root, directory), Package::read(&root, package)?);
            }
        }
        Ok(Self { all, workspaces })
    }

    pub(super) fn files(&self) -> usize {
        self.all.values().map(|package| package.files).sum()
    }

    /// Returns the pairs of packages of which the first has the second as a normal dependency.
    pub(super) fn arrows(&self) -> BTreeSet<(Directory, Directory)> {
        let packages = self.all.iter();
        let arrows = packages.flat_map(|(from, package)| {
            let to = package.dependencies.iter();
            to.map(|to| (from.clone(), to.clone()))
        });
        arrows.collect()
    }
}

impl Package {
    /// Reads a package that `cargo metadata` describes.
    fn read(root: &Path, package: &Value) -> Result<Self> {
        const OTHERS: [&str; 4] = ["bench", "custom-build", "example", "test"];
        let manifest = Path::new(text(&package["manifest_path"]));
        let directory = manifest.parent().unwrap_or(manifest);
        let targets = list(&package["targets"]).iter();
        let files = targets
            .clone()
            .map(|target| Path::new(text(&target["src_path"])));
        let reaches = reaches(directory, files)?;
        let own = targets.filter(|target| !OTHERS.contains(&text(&target["kind"][0])));
        let crates = own.map(|target| Modules::read(Path::new(text(&target["src_path"]))));
        let crates = crates.collect::<Result<Vec<_>>>()?;
        let files: BTreeSet<&Path> = crates.iter().flat_map(Modules::files).collect();
        let mut lines = 0;
        for file in &files {
            lines += sources::lines_of_code(&fs::read_to_string(file)?);
        }
        let dependencies = list(&package["dependencies"]).iter();
        let normal = dependencies.filter(|dependency| dependency["kind"].is_null());
        let normal = normal.filter_map(|dependency| dependency["path"].as_str());
        Ok(Self {
            name: text(&package["name"]).to_owned(),
            lines,
            files: files.len(),
            dependencies: normal.map(|path| place(root, Path::new(path))).collect(),
            crates,
            reaches,
        })
    }
}

fn has_workspace(manifest: &str) -> bool {
    manifest.lines().any(|line| line.trim() == "[workspace]")
}

fn place(root: &Path, directory: &Path) -> Directory {
    let directory = directory.strip_prefix(root).unwrap_or(directory);
    let names = directory.iter();
    names
        .map(|name| name.to_string_lossy().into_owned())
        .collect()
}
