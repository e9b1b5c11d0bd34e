//! README.md says what is true, where no compiler looks.

use std::fs;
use std::path::{Path, PathBuf};

fn sources(directory: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else {
            found.push(path);
        }
    }
}

/// How often the code of a file says `unsafe`.
fn count_unsafe(text: &str) -> usize {
    text.lines()
        .map(|line| line.split("//").next().unwrap_or(line))
        .flat_map(|code| code.split(|c: char| !c.is_alphanumeric() && c != '_'))
        .filter(|word| *word == "unsafe")
        .count()
}

#[test]
fn every_use_of_unsafe_is_listed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let readme = fs::read_to_string(root.join("README.md")).unwrap();
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    for file in files {
        let name = file.strip_prefix(root).unwrap().display().to_string();
        let count = count_unsafe(&fs::read_to_string(&file).unwrap());
        let listed = readme
            .lines()
            .find_map(|line| {
                line.strip_prefix(&format!("| `{name}` | "))?
                    .split(' ')
                    .next()
            })
            .map_or(0, |count| count.parse().unwrap());
        assert_eq!(count, listed, "{name}");
    }
}
