//! A table of README.md says how often each file of a library has `unsafe` in its code.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::Result;
use crate::context::{Context, text};
use crate::parts::Summary;
use crate::sources;

/// The number of times that each file has the word.
type Counts = BTreeMap<String, usize>;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let (mut libraries, mut uses) = (0, 0);
    for package in context.members()? {
        let root = Path::new(text(&package["manifest_path"])).parent();
        let root = root.ok_or("a package is in no directory")?;
        if !root.join("src/lib.rs").is_file() {
            continue;
        }
        let name = text(&package["name"]);
        let counted = counted(root)?;
        let listed = listed(&fs::read_to_string(root.join("README.md"))?);
        if let Some(problem) = difference(&counted, &listed) {
            return Err(format!("README.md of {name}: {problem}").into());
        }
        libraries += 1;
        uses += counted.values().sum::<usize>();
    }
    if uses == 0 {
        return Err("found no use of `unsafe` in any library, so the search is broken".into());
    }
    Ok(Summary::of(format!("{uses} uses in {libraries} libraries")))
}

/// Counts the word in the sources below `root`.
fn counted(root: &Path) -> Result<Counts> {
    let mut counts = Counts::new();
    for file in sources::below(&root.join("src"), &|_| false)? {
        let count = uses_in(&fs::read_to_string(&file)?);
        if count > 0 {
            counts.insert(file.strip_prefix(root)?.display().to_string(), count);
        }
    }
    Ok(counts)
}

/// Returns the number of times that the code of a file has the word, comments left out.
fn uses_in(text: &str) -> usize {
    text.lines()
        .map(|line| line.split("//").next().unwrap_or(line))
        .flat_map(|code| code.split(|c: char| !c.is_alphanumeric() && c != '_'))
        .filter(|word| *word == "unsafe")
        .count()
}

/// Returns the rows of a table that name a source file and a number.
fn listed(readme: &str) -> Counts {
    let row = |line: &str| {
        let mut cells = line.strip_prefix("| `")?.split('|');
        let name = cells.next()?.trim().strip_suffix('`')?;
        let count = cells.next()?.trim().parse().ok()?;
        name.starts_with("src/").then(|| (name.to_owned(), count))
    };
    readme.lines().filter_map(row).collect()
}

/// Returns the first file of which the two have different counts.
fn difference(counted: &Counts, listed: &Counts) -> Option<String> {
    let of = |counts: &Counts, name: &String| counts.get(name).copied().unwrap_or(0);
    counted
        .keys()
        .chain(listed.keys())
        .map(|name| (name, of(counted, name), of(listed, name)))
        .find(|(_, there, said)| there != said)
        .map(|(name, there, said)| format!("{name} has `unsafe` {there} times, not {said}"))
}

#[cfg(test)]
mod tests {
    use super::{difference, listed, uses_in};

    #[test]
    fn counts_words_of_code() {
        let code = "unsafe { f() } // unsafe\n#![allow(unsafe_code)]\npub unsafe fn f() {}\n";
        assert_eq!(uses_in(code), 2);
    }

    #[test]
    fn finds_what_is_not_listed_and_what_is_not_there() {
        let readme = "| file | times |\n|---|---|\n| `src/a.rs` | 2 | for speed |\n| `b` | 3 |\n";
        let said = listed(readme);
        assert_eq!(said, [("src/a.rs".to_owned(), 2)].into());
        assert_eq!(difference(&said, &said), None);
        for other in [
            [("src/a.rs".to_owned(), 1)].into(),
            [("src/a.rs".to_owned(), 2), ("src/b.rs".to_owned(), 1)].into(),
            [].into(),
        ] {
            assert!(difference(&other, &said).is_some(), "{other:?}");
        }
    }
}
