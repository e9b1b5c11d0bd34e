//! `cargo xtask words --path FOLDER`: the findings of a folder, here or of another project, and their share.
//!
//! With `--sample N` only the first paragraphs of N public items of each folder are checked, drawn by `--seed`. This
//! measures how often the rules refuse a good text: give it folders of well-written crates. Functions whose docs do not
//! begin in the third person are left out; without `--sample` they are checked too.

use std::path::Path;

use super::text::{Kind, Text};
use super::{Rules, check, finding_line, read};
use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::sources;

pub(super) fn run(context: &Context, rules: &Rules) -> Result<Summary> {
    let (mut checked, mut refused, mut unread) = (0, 0, 0);
    for folder in &context.options.words.path {
        let folder = folder
            .canonicalize()
            .map_err(|error| format!("{}: {error}", folder.display()))?;
        // Tests, benchmarks and examples are left out.
        let others = ["tests", "benches", "examples"];
        let files = sources::below(&folder, &|it| others.iter().any(|name| it.ends_with(name)))?;
        let mut texts = Vec::new();
        for file in files {
            if file.ends_with("tests.rs") || file.ends_with("build.rs") {
                continue;
            }
            let name = file.strip_prefix(&context.root).unwrap_or(&file);
            let name = name.display().to_string();
            match read(&file)? {
                Ok(found) => texts.extend(found.into_iter().map(|text| (name.clone(), text))),
                Err(_) => unread += 1,
            }
        }
        if let Some(size) = context.options.words.sample {
            texts = drawn(texts, size, context.options.words.seed);
        }
        for (path, text) in &texts {
            let found = check(rules, path, std::slice::from_ref(text));
            for finding in &found {
                println!("{}", finding_line(path, finding));
            }
            checked += 1;
            refused += usize::from(!found.is_empty());
        }
        println!("{}: {} texts", shown(&folder), texts.len());
    }
    if checked == 0 {
        return Err("found no text to check in these folders".into());
    }
    let summary = Summary::of(format!("{refused} of {checked} texts have findings"));
    Ok(if unread == 0 {
        summary
    } else {
        summary.leaving_out(format!("{unread} files that syn cannot parse"))
    })
}

fn shown(folder: &Path) -> String {
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    name.display().to_string()
}

/// Returns true if a word of an indicative stands first, or follows an adverb. Any word that ends in "s" counts, so
/// that the list of verbs is measured, too.
fn is_indicative(summary: &str) -> bool {
    let mut words = summary.split([' ', ',', '.']);
    let first = words.next().unwrap_or_default();
    let second = words.next().unwrap_or_default();
    first.ends_with('s') || first.ends_with("ly") && second.ends_with('s')
}

/// Draws the first paragraphs of public items. An imperative, or a function without a verb, is refused by the style of
/// this project on purpose, however usual it is elsewhere, so it is not drawn.
fn drawn(texts: Vec<(String, Text)>, size: usize, seed: u64) -> Vec<(String, Text)> {
    let items = texts.into_iter().filter(|(_, text)| {
        let item = matches!(text.kind, Kind::Function | Kind::Type | Kind::Value);
        item && text.public && (text.kind != Kind::Function || is_indicative(&text.summary()))
    });
    let mut state = seed;
    let mut keyed: Vec<_> = items.map(|item| (next(&mut state), item)).collect();
    keyed.sort_by_key(|(key, _)| *key);
    keyed.truncate(size);
    let first = keyed.into_iter().map(|(_, (path, mut text))| {
        text.body = text.summary();
        (path, text)
    });
    first.collect()
}

/// Returns the next number of splitmix64 (Steele, Lea, Flood 2014).
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut mixed = *state;
    mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}
