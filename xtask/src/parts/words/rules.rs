//! [`Rules`]: the rules of `xtask/words.toml`, and the findings of a text.

use std::collections::BTreeSet;

use regex::{Regex, RegexBuilder, RegexSet, RegexSetBuilder};
use serde::Deserialize;

use super::counts::Table;
use super::text::{Kind, Text};
use crate::Result;

/// The file of rules and exceptions.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    verb: Verb,
    errors: Errors,
    echo: Echo,
    list: Vec<List>,
    #[serde(default)]
    exception: Vec<Exception>,
    #[serde(default)]
    findings: Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Verb {
    reason: String,
    write: String,
    verbs: String,
    also: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Errors {
    reason: String,
    write: String,
    variant: String,
    condition: String,
    long: usize,
    never: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Echo {
    reason: String,
    write: String,
    skip: String,
}

/// A rule that is a list of patterns.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    name: String,
    reason: String,
    write: String,
    on: Vec<String>,
    refuse: Vec<Pattern>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pattern {
    find: String,
    unless: Option<String>,
    write: String,
    #[serde(default)]
    not_in: Vec<String>,
}

/// A single finding that is right as it stands, and the reason.
#[derive(Deserialize, Clone)]
#[serde(deny_unknown_fields)]
pub(super) struct Exception {
    pub path: String,
    pub rule: String,
    /// A part of the finding's text.
    pub text: String,
    pub reason: String,
}

/// A text that breaks a rule.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Finding {
    pub line: usize,
    pub rule: String,
    pub text: String,
    /// The words to write instead.
    pub remedy: String,
    /// True if the text is one for users; the others have counts of their own.
    pub public: bool,
}

/// All rules, ready to be applied.
pub(super) struct Rules {
    verbs: BTreeSet<String>,
    also: Regex,
    verb_remedy: String,
    variant: Regex,
    condition: Regex,
    never: Regex,
    long: usize,
    errors_remedy: String,
    skip: BTreeSet<String>,
    echo_remedy: String,
    lists: Vec<Compiled>,
    pub exceptions: Vec<Exception>,
    pub table: Table,
}

struct Compiled {
    name: String,
    on: Vec<String>,
    /// All patterns: most texts match none.
    any: RegexSet,
    patterns: Vec<(Regex, Option<Regex>, Pattern)>,
}

impl Rules {
    /// Reads the text of `words.toml`.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let file: File = toml::from_str(text)?;
        let lists = file.list.into_iter().map(List::compiled);
        let lists: Vec<_> = lists.collect::<Result<_>>()?;
        let (verb, errors, echo) = (file.verb, file.errors, file.echo);
        if [&verb.reason, &errors.reason, &echo.reason]
            .iter()
            .any(|it| it.is_empty())
            || file.exception.iter().any(|it| it.reason.is_empty())
        {
            return Err("xtask/words.toml has a rule or an exception without a reason".into());
        }
        Ok(Self {
            verbs: words(&verb.verbs),
            also: regex(&verb.also)?,
            verb_remedy: verb.write,
            variant: regex(&errors.variant)?,
            condition: regex(&errors.condition)?,
            never: regex(&errors.never)?,
            long: errors.long,
            errors_remedy: errors.write,
            skip: words(&echo.skip),
            echo_remedy: echo.write,
            lists,
            exceptions: file.exception,
            table: file.findings,
        })
    }

    /// Returns the findings of a text in the file `path`, in the order of their lines.
    pub(super) fn check(&self, path: &str, text: &Text) -> Vec<Finding> {
        let mut found = Vec::new();
        let class = text.kind.class(text.public);
        let mut add = |line: usize, rule: &str, shown: &str, remedy: &str| {
            found.push(Finding {
                line,
                rule: rule.to_owned(),
                text: shortened(shown),
                remedy: remedy.to_owned(),
                public: class != "private",
            });
        };
        if class == "docs" && text.kind == Kind::Function {
            let summary = text.summary();
            if !self.begins_with_verb(&summary) {
                let third = self.third_person(&summary);
                let remedy = third.as_deref().unwrap_or(&self.verb_remedy);
                add(text.line, "verb", &summary, remedy);
            }
            if let Some((line, section)) = section(text, "Errors")
                && !self.names_errors(&section)
            {
                add(line, "errors", &section, &self.errors_remedy);
            }
        }
        // A function's verb often is its name: "Clears the queue." on `clear_queue`.
        if matches!(text.kind, Kind::Type | Kind::Value) && self.is_echo(text) {
            add(text.line, "echo", &text.summary(), &self.echo_remedy);
        }
        let covered = text.covered();
        let begin = covered.len() - covered.trim_start().len();
        for list in &self.lists {
            if !list.on.iter().any(|it| it == class) {
                continue;
            }
            let body = covered.trim_start();
            for index in list.any.matches(body) {
                let (find, unless, pattern) = &list.patterns[index];
                if pattern.not_in.iter().any(|it| path.starts_with(it)) {
                    continue;
                }
                let right: Vec<_> = unless
                    .iter()
                    .flat_map(|unless| unless.find_iter(body))
                    .collect();
                for place in find.find_iter(body) {
                    let covers = |it: &regex::Match<'_>| {
                        it.start() < place.end() && place.start() < it.end()
                    };
                    if !right.iter().any(covers) {
                        let start = begin + place.start();
                        let line = text.line_of(start);
                        add(line, &list.name, around(&text.body, start), &pattern.write);
                    }
                }
            }
        }
        found.sort();
        found.dedup();
        found
    }

    fn begins_with_verb(&self, summary: &str) -> bool {
        if self.also.is_match(summary) {
            return true;
        }
        let text = summary.trim_start_matches(['*', '_', '(', '"']);
        let mut words = text.split(|it: char| !it.is_alphanumeric() && it != '-' && it != '\'');
        let Some(first) = words.next() else {
            return false;
        };
        let first = first.to_lowercase();
        let is_verb = |word: &str| {
            // "Re-reads", "Un-does".
            let last = word.rsplit('-').next().unwrap_or(word);
            self.verbs.contains(word) || self.verbs.contains(last)
        };
        if is_verb(&first) {
            return true;
        }
        // "If the queue is empty, returns `None`."
        if [
            "if", "when", "unless", "until", "on", "for", "in", "like", "unlike", "given", "after",
            "before",
        ]
        .contains(&&*first)
        {
            let clauses = text.split(", ").skip(1);
            let mut begins = clauses.filter_map(|it| it.split(' ').next());
            return begins.any(is_verb);
        }
        let adverb =
            first.ends_with("ly") || ["also", "just", "always", "never"].contains(&&*first);
        let second = words.find(|it| !it.is_empty()).unwrap_or_default();
        adverb && is_verb(&second.to_lowercase())
    }

    /// Returns the first word of an imperative in the third person: `Returns` for "Return the length".
    fn third_person(&self, summary: &str) -> Option<String> {
        let first = summary.split(' ').next()?;
        let forms = [
            format!("{first}s"),
            format!("{first}es"),
            format!("{}ies", first.trim_end_matches('y')),
        ];
        let mut forms = forms.into_iter();
        forms.find(|form| self.verbs.contains(&form.to_lowercase()))
    }

    fn names_errors(&self, section: &str) -> bool {
        let says_when = self.condition.is_match(section) || section.chars().count() >= self.long;
        !self.never.is_match(section) && self.variant.is_match(section) && says_when
    }

    /// Returns true if all words of the doc are words of the item's name.
    fn is_echo(&self, text: &Text) -> bool {
        // "1/sqrt(3)" has the words of `FRAC_1_SQRT_3` and says more.
        if text.body.contains(|it: char| it.is_ascii_digit()) {
            return false;
        }
        let name = split(&text.name);
        let name: BTreeSet<_> = name.iter().map(|it| stem(it)).collect();
        let doc = split(&text.body);
        let mut words = doc.iter().filter(|it| !self.skip.contains(*it)).peekable();
        words.peek().is_some() && words.all(|it| name.contains(stem(it)))
    }
}

impl List {
    fn compiled(self) -> Result<Compiled> {
        if self.reason.is_empty() || self.write.is_empty() {
            return Err(format!("the rule `{}` has no reason or remedy", self.name).into());
        }
        let classes = ["docs", "private", "prose", "texts"];
        if let Some(it) = self.on.iter().find(|it| !classes.contains(&it.as_str())) {
            return Err(format!("the rule `{}` has an unknown kind `{it}`", self.name).into());
        }
        let finds = self.refuse.iter().map(|it| &it.find);
        let any = RegexSetBuilder::new(finds).unicode(false).build()?;
        let patterns = self.refuse.into_iter().map(|pattern| {
            let unless = pattern.unless.as_deref().map(regex).transpose()?;
            Ok((regex(&pattern.find)?, unless, pattern))
        });
        Ok(Compiled {
            name: self.name,
            on: self.on,
            any,
            patterns: patterns.collect::<Result<_>>()?,
        })
    }
}

fn regex(text: &str) -> Result<Regex> {
    Ok(RegexBuilder::new(text).unicode(false).build()?)
}

fn words(text: &str) -> BTreeSet<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

/// Returns the words of a name or a sentence, in lower case: `SlotState` and `slot_state` have two.
fn split(text: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    let mut before = ' ';
    for character in text.chars() {
        let begins = character.is_uppercase() && !before.is_uppercase();
        if begins || !character.is_alphanumeric() {
            found.push(String::new());
        }
        if character.is_alphanumeric()
            && let Some(word) = found.last_mut()
        {
            word.extend(character.to_lowercase());
        }
        before = character;
    }
    found.retain(|word| !word.is_empty());
    found
}

/// Returns the word without the ending of a plural or of a verb.
fn stem(word: &str) -> &str {
    let short = word
        .strip_suffix("es")
        .or_else(|| word.strip_suffix('s'))
        .unwrap_or(word);
    short.strip_suffix('e').unwrap_or(short)
}

/// Returns the section below a heading, in one line, and the number of its first line.
fn section(text: &Text, title: &str) -> Option<(usize, String)> {
    let mut lines = text.body.lines().enumerate().skip_while(|(_, line)| {
        let heading = line.trim_start_matches('#');
        heading == *line || heading.trim() != title
    });
    let (heading, _) = lines.next()?;
    let body = lines.take_while(|(_, line)| !line.starts_with('#'));
    let body: Vec<_> = body.map(|(_, line)| line.trim()).collect();
    Some((text.line + heading, body.join(" ").trim().to_owned()))
}

fn shortened(text: &str) -> String {
    /// More does not fit into a line of a log.
    const LONG: usize = 90;
    let text = text.trim();
    if text.chars().count() <= LONG {
        return text.to_owned();
    }
    text.chars().take(LONG).chain(['…']).collect()
}

/// Returns the line in which the offset lies, without what is far before it.
fn around(text: &str, offset: usize) -> &str {
    let start = text[..offset].rfind('\n').map_or(0, |it| it + 1);
    let near = text[start..offset].char_indices().rev().nth(40);
    let start = near.map_or(start, |(it, _)| start + it);
    let rest = &text[start..];
    rest.split('\n').next().unwrap_or(rest)
}
