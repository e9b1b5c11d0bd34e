//! [`Table`]: how many findings each file may still have. The counts only shrink.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use serde::Deserialize;

use crate::Result;

/// The line of `words.toml` below which the counts stand.
const HEADING: &str = "[findings]\n";

/// The counts by path.
pub(super) type Table = BTreeMap<String, Count>;

/// The findings of a file.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Count {
    /// Findings in docs of public items, in prose, and in texts for people.
    #[serde(default)]
    pub public: usize,
    /// Findings in docs of other items, and in comments.
    #[serde(default)]
    pub private: usize,
}

impl Count {
    fn sum(self) -> usize {
        self.public + self.private
    }

    /// Returns the line of `words.toml` that says the count.
    fn line(self, path: &str) -> String {
        let Self { public, private } = self;
        format!("\"{path}\" = {{ public = {public}, private = {private} }}")
    }
}

/// Returns the paths with more findings than `listed` says, and what to do about each path whose count differs.
pub(super) fn compare(listed: &Table, found: &Table) -> (Vec<String>, Vec<String>) {
    let (mut more, mut remedies) = (Vec::new(), Vec::new());
    let paths = listed.keys().chain(found.keys());
    let paths: BTreeSet<_> = paths.collect();
    for path in paths {
        let of = |table: &Table| table.get(path).copied().unwrap_or_default();
        let (listed, found) = (of(listed), of(found));
        if found.public > listed.public || found.private > listed.private {
            more.push(path.clone());
            let (a, b) = (listed.public, listed.private);
            let (c, d) = (found.public, found.private);
            remedies.push(format!(
                "{path}: {c} public and {d} private findings, and {a} and {b} are allowed"
            ));
        } else if found != listed && found == Count::default() {
            remedies.push(format!("{path}: no finding is left; remove its line"));
        } else if found != listed {
            let line = found.line(path);
            remedies.push(format!("{path}: fewer findings are left; write {line}"));
        }
    }
    (more, remedies)
}

/// Returns the text of `words.toml` with the counts of `found`.
///
/// # Errors
/// Returns an error that names the files whose count would rise. New paths may have as many findings as
/// those that are not in `files` any more.
pub(super) fn recorded(
    text: &str,
    listed: &Table,
    found: &Table,
    files: &BTreeSet<String>,
) -> Result<String> {
    let (new, old): (Vec<_>, Vec<_>) = compare(listed, found)
        .0
        .into_iter()
        .partition(|path| !listed.contains_key(path));
    let gone = listed.iter().filter(|(path, _)| !files.contains(*path));
    let gone: usize = gone.map(|(_, count)| count.sum()).sum();
    let came: usize = new.iter().map(|path| found[path].sum()).sum();
    if !old.is_empty() {
        return Err(format!(
            "these files have more findings than before, and --record only lowers counts; mend the new findings: {}",
            old.join(", ")
        )
        .into());
    }
    if came > gone {
        let new = new.join(", ");
        return Err(format!(
            "these files are new and have findings, which --record does not allow; mend the texts: {new}"
        )
        .into());
    }
    let rules = text.split(HEADING).next().unwrap_or(text).trim_end();
    let mut text = format!("{rules}\n\n{HEADING}");
    for (path, count) in found {
        let _ = writeln!(text, "{}", count.line(path));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::{Count, Table, compare, recorded};

    fn table(counts: &[(&str, usize, usize)]) -> Table {
        let count = |(path, public, private): &(&str, usize, usize)| {
            let (public, private) = (*public, *private);
            ((*path).to_owned(), Count { public, private })
        };
        counts.iter().map(count).collect()
    }

    #[test]
    fn more_findings_and_fewer_both_fail() {
        let listed = table(&[("a", 2, 3), ("b", 1, 0), ("c", 1, 1)]);
        let found = table(&[("a", 2, 2), ("c", 2, 0)]);
        let (more, remedies) = compare(&listed, &found);
        assert_eq!(more, ["c"]);
        assert_eq!(remedies.len(), 3, "{remedies:?}");
        assert!(remedies[0].ends_with("write \"a\" = { public = 2, private = 2 }"));
        assert_eq!(compare(&listed, &listed).1, Vec::<String>::new());
    }

    #[test]
    fn a_record_raises_no_count_and_follows_files_that_move() {
        let listed = table(&[("a", 2, 0), ("b", 1, 0)]);
        let text = "# Rules.\n\n[findings]\n\"a\" = { public = 9 }\n";
        let files = |files: &[&str]| files.iter().map(ToString::to_string).collect();
        let record = |found: &[(&str, usize, usize)]| {
            let paths: Vec<_> = found.iter().map(|(path, ..)| *path).collect();
            recorded(text, &listed, &table(found), &files(&paths))
        };
        assert!(record(&[("a", 3, 0)]).is_err());
        assert!(record(&[("a", 2, 1)]).is_err());
        assert!(record(&[("a", 2, 0), ("b", 1, 0), ("c", 0, 1)]).is_err());
        let mended = table(&[("a", 2, 0), ("c", 0, 1)]);
        assert!(recorded(text, &listed, &mended, &files(&["a", "b", "c"])).is_err());
        let moved = record(&[("a", 1, 0), ("c/b", 1, 0)]).unwrap();
        assert_eq!(
            moved,
            "# Rules.\n\n[findings]\n\"a\" = { public = 1, private = 0 }\n\
             \"c/b\" = { public = 1, private = 0 }\n"
        );
    }
}
