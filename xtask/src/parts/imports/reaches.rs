//! [`reaches`]: sources that a package takes from outside of itself.

use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::Result;
use crate::sources;

/// Returns the places that reach out of a package: the sources of `targets`, which are those of its
/// manifest with its build script, and the files that its sources name by `#[path]` or `include!`. Texts
/// and data (`include_str!`) may be those of other packages.
pub(super) fn reaches<'t>(
    package: &Path,
    targets: impl Iterator<Item = &'t Path>,
) -> Result<Vec<String>> {
    let outside = |path: &Path| !plain(path).starts_with(package);
    let mut found: Vec<_> = targets
        .filter(|path| outside(path))
        .map(|path| format!("Cargo.toml reaches {}", plain(path).display()))
        .collect();
    // Packages in its folders answer for themselves.
    for file in sources::below(package, &|folder| folder.join("Cargo.toml").is_file())? {
        let source = fs::read_to_string(&file)?;
        let directory = file.parent().unwrap_or(package);
        let named = source.lines().filter_map(named);
        let named = named.filter(|name| outside(&directory.join(name)));
        let own = file.strip_prefix(package)?.display();
        found.extend(named.map(|name| format!("{own} reaches {name}")));
    }
    Ok(found)
}

/// Returns the file that a line takes as source.
fn named(line: &str) -> Option<&str> {
    let attribute = line.trim_start().strip_prefix("#[path = \"");
    let included = || Some(line.split_once("include!(\"")?.1);
    let (name, _) = attribute.or_else(included)?.split_once('"')?;
    Some(name)
}

/// Returns the path without `..`, as no folder is a link.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => drop(plain.pop()),
            component => plain.push(component),
        }
    }
    plain
}
