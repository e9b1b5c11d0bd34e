//! Rules for docs, comments, READMEs, help and error texts. All of them, and the exceptions, are in `xtask/words.toml`.
//!
//! A file may have as many findings as the counts of `xtask/words.toml` say, no more and no fewer: whoever mends a text
//! lowers the count, by hand or with `--record`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::Result;
use crate::command::side_by_side;
use crate::context::Context;
use crate::parts::Summary;

mod counts;
mod prose;
mod rules;
mod sample;
#[cfg(test)]
mod seeded;
mod source;
mod text;

use counts::{Count, Table};
use rules::{Exception, Finding, Rules};
use text::Text;

/// The findings of the files, by path from the root of the repository.
type Findings = BTreeMap<String, Vec<Finding>>;

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let file = context.root.join("xtask/words.toml");
    let written = fs::read_to_string(&file)?;
    let rules = Rules::parse(&written).map_err(|error| format!("xtask/words.toml: {error}"))?;
    let options = &context.options.words;
    if !options.path.is_empty() {
        return sample::run(context, &rules);
    }
    let files = repository(context)?;
    let checked = side_by_side(&files, |path| {
        let texts = read(&context.root.join(path))?;
        let texts = texts.map_err(|problem| format!("{path}: {problem}"))?;
        Ok((texts.len(), check(&rules, path, &texts)))
    })?;
    let texts: usize = checked.iter().map(|(texts, _)| texts).sum();
    if texts == 0 {
        return Err("found no text to check in any file of the repository".into());
    }
    let found = checked.into_iter().map(|(_, findings)| findings);
    let mut found: Findings = files.iter().cloned().zip(found).collect();
    let unused = apply_exceptions(&rules.exceptions, &mut found);
    if let Some(exception) = unused.first() {
        let Exception { path, rule, .. } = exception;
        return Err(format!("remove the exception of {path} from `{rule}` in xtask/words.toml: nothing needs it any \
         more").into());
    }
    let table = counted(&found);
    if options.record {
        let paths = found.keys().cloned().collect();
        let text = counts::recorded(&written, &rules.table, &table, &paths)?;
        fs::write(&file, text)?;
    } else {
        judge(&rules.table, &table, &found)?;
    }
    let (public, private) = table.values().fold((0, 0), |(public, private), count| {
        (public + count.public, private + count.private)
    });
    Ok(Summary::of(format!(
        "{texts} texts of {} files; {public} public and {private} private findings are still allowed",
        files.len()
    )))
}

/// Prints the findings of the files that have more than their counts, and the counts that must change.
fn judge(listed: &Table, counts: &Table, found: &Findings) -> Result<()> {
    let (more, remedies) = counts::compare(listed, counts);
    for path in &more {
        let listed = listed.get(path).copied().unwrap_or_default();
        for finding in &found[path] {
            let (allowed, there) = if finding.public {
                (listed.public, counts[path].public)
            } else {
                (listed.private, counts[path].private)
            };
            if there > allowed {
                eprintln!("{}", finding_line(path, finding));
            }
        }
    }
    for remedy in &remedies {
        eprintln!("{remedy}");
    }
    if remedies.is_empty() {
        return Ok(());
    }
    let (fewer, more) = (remedies.len() - more.len(), more.len());
    Err(format!(
        "{more} files have more findings than xtask/words.toml allows: mend their texts; {fewer} have fewer: run \
         `cargo xtask words --record`"
    )
    .into())
}

fn finding_line(path: &str, finding: &Finding) -> String {
    let Finding {
        line,
        rule,
        text,
        remedy,
        ..
    } = finding;
    format!("{path}:{line}: {rule}: {} ({remedy})", text.trim())
}

/// Removes the findings that are excepted, and returns the exceptions that match none.
fn apply_exceptions<'e>(exceptions: &'e [Exception], found: &mut Findings) -> Vec<&'e Exception> {
    let mut unused = Vec::new();
    for exception in exceptions {
        let findings = found.get_mut(&exception.path);
        let place = findings.and_then(|findings| {
            let is_it =
                |it: &Finding| it.rule == exception.rule && it.text.contains(&exception.text);
            let place = findings.iter().position(is_it)?;
            Some(findings.remove(place))
        });
        if place.is_none() {
            unused.push(exception);
        }
    }
    unused
}

fn counted(found: &Findings) -> Table {
    let count = |findings: &Vec<Finding>| {
        let public = findings.iter().filter(|finding| finding.public).count();
        Count {
            public,
            private: findings.len() - public,
        }
    };
    found
        .iter()
        .filter(|(_, findings)| !findings.is_empty())
        .map(|(path, findings)| (path.clone(), count(findings)))
        .collect()
}

fn check(rules: &Rules, path: &str, texts: &[Text]) -> Vec<Finding> {
    let found = texts.iter().flat_map(|text| rules.check(path, text));
    let mut found: Vec<_> = found.collect();
    found.sort();
    found
}

/// Reads the texts of a file; the inner error is one of its syntax.
fn read(path: &Path) -> Result<Result<Vec<Text>, String>> {
    let source =
        fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    if path.extension().is_some_and(|it| it == "md") {
        return Ok(Ok(prose::read(&source)));
    }
    Ok(source::read(&source).map_err(|error| error.to_string()))
}

/// Returns the paths of the files to read, from the root: all sources but those of tests, all README.md files and the
/// files of `docs`.
fn repository(context: &Context) -> Result<Vec<String>> {
    let line = context.command("git ls-files --cached --others --exclude-standard");
    let listed = line.read()?;
    let files: BTreeSet<_> = listed.lines().collect();
    let chosen = files.iter().filter(|path| {
        let path = Path::new(path);
        let is_text = match path.extension().and_then(|it| it.to_str()) {
            Some("rs") => !is_of_tests(&context.root, path),
            Some("md") => path.ends_with("README.md") || path.starts_with("docs"),
            _ => false,
        };
        // A file that is removed and not yet committed is still listed.
        is_text && context.root.join(path).is_file()
    });
    Ok(chosen.map(|path| (*path).to_owned()).collect())
}

/// Returns true if a file lies in the folder `tests` of a package, or holds the tests of a module.
fn is_of_tests(root: &Path, path: &Path) -> bool {
    path.file_name().is_some_and(|name| name == "tests.rs")
        || path.ancestors().any(|folder| {
            let package = folder.parent().map(|it| root.join(it));
            folder.ends_with("tests") && package.is_some_and(|it| it.join("src").is_dir())
        })
}
