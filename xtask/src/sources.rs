//! The Rust files of a folder, and which of their items are for tests.

use std::fs;
use std::path::{Path, PathBuf};

use syn::{Attribute, Item, Meta};

use crate::Result;

/// Returns the Rust files in `folder` and below, in order, without those in folders that `is_left_out` names.
///
/// # Errors
/// Returns the error of a folder that cannot be read, with its path.
pub(crate) fn below(folder: &Path, is_left_out: &dyn Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    let mut files = files(folder, is_left_out)?;
    files.retain(|file| file.extension().is_some_and(|it| it == "rs"));
    Ok(files)
}

/// Returns the files in `folder` and below, in order. Folders that cargo has built, that are hidden, or that
/// `is_left_out` names are not entered.
///
/// # Errors
/// Returns the error of a folder that cannot be read, with its path.
pub(crate) fn files(folder: &Path, is_left_out: &dyn Fn(&Path) -> bool) -> Result<Vec<PathBuf>> {
    let (mut found, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        let entries = fs::read_dir(&folder);
        for entry in entries.map_err(|error| format!("{}: {error}", folder.display()))? {
            let entry = entry?;
            let path = entry.path();
            let name = path.file_name().unwrap_or_default();
            if !entry.file_type()?.is_dir() {
                found.push(path);
            } else if name != "target"
                && !name.as_encoded_bytes().starts_with(b".")
                && !is_left_out(&path)
            {
                folders.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Returns the number of lines that are neither empty nor a comment.
pub(crate) fn lines_of_code(source: &str) -> usize {
    let code = |line: &&str| !line.is_empty() && !line.starts_with("//");
    source.lines().map(str::trim).filter(code).count()
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
