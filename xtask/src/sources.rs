//! The Rust files of a folder, and which of their items are for tests.

use std::fs;
use std::path::{Path, PathBuf};

use syn::{Attribute, Item, Meta};

use crate::Result;

/// Returns the Rust files in `folder` and below, in order. Folders that cargo has built, that are hidden, or that
/// `is_left_out` names are not entered.
///
/// # Errors
/// Returns the error of a folder that cannot be read, with its path.
pub(crate) fn below(folder: &Path, is_left_out: &dyn Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    add(folder, is_left_out, &mut found)?;
    found.sort();
    Ok(found)
}

fn add(folder: &Path, is_left_out: &dyn Fn(&Path) -> bool, found: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default();
        if path.is_dir() {
            let is_built = name == "target" || name.as_encoded_bytes().starts_with(b".");
            if !is_built && !is_left_out(&path) {
                add(&path, is_left_out, found)?;
            }
        } else if path.extension().is_some_and(|it| it == "rs") {
            found.push(path);
        }
    }
    Ok(())
}

/// Returns the attributes of an item of a kind that can be for tests alone.
pub(crate) fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// Returns the condition of each `#[cfg(…)]` among the attributes.
fn conditions(attributes: &[Attribute]) -> impl Iterator<Item = String> {
    attributes
        .iter()
        .filter_map(|attribute| match &attribute.meta {
            Meta::List(list) if list.path.is_ident("cfg") => Some(list.tokens.to_string()),
            _ => None,
        })
}

/// Returns true if there is a `#[cfg(test)]`, or one of loom's tests.
pub(crate) fn is_for_tests(attributes: &[Attribute]) -> bool {
    conditions(attributes).any(|it| it == "test" || it.starts_with("all (test"))
}

/// Returns true if there is a `#[cfg(feature = "hostile")]`: of what tests share with fuzz targets.
pub(crate) fn is_for_fuzzing(attributes: &[Attribute]) -> bool {
    conditions(attributes).any(|it| it.contains("feature = \"hostile\""))
}
