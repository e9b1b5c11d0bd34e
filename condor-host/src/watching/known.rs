//! [`Known`]: all names that there are.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use condor_mbox::linux::LinuxWindow;
use condor_vars::{Entry, Table, TableError};
use wildmatch::WildMatch;

use super::types::Type;
use crate::control::Member;
use crate::error::AnyError;
use crate::plain::plain;
use crate::view::View;

/// How many names are suggested.
const SUGGESTIONS: usize = 5;

/// A variable, a parameter, or a field of a cell.
pub(crate) struct One {
    pub(crate) member: Arc<Member>,
    /// The name of its loop or cell.
    pub(crate) owner: Arc<str>,
    pub(crate) name: String,
    pub(crate) table: Table<LinuxWindow>,
    pub(crate) entry: Entry,
    pub(crate) of: Type,
}

impl One {
    fn read(
        member: &Arc<Member>,
        owner: &Arc<str>,
        table: &Table<LinuxWindow>,
        entry: Entry,
    ) -> Result<Self, TableError> {
        let name = match table.cell() {
            Some(_) => format!("{owner}.{}", entry.name),
            None => entry.name.to_string(),
        };
        let mut labels = Vec::new();
        for number in 0..entry.labels.into() {
            let label = table.label(&entry, number)?;
            labels.push(label.unwrap_or_default().to_string());
        }
        let kind = entry.kind;
        Ok(Self {
            member: member.clone(),
            owner: owner.clone(),
            name,
            table: table.clone(),
            entry,
            of: Type { kind, labels },
        })
    }

    pub(crate) fn is_field(&self) -> bool {
        self.table.cell().is_some()
    }

    pub(crate) const fn can_be_set(&self) -> bool {
        self.entry.bounds.is_some()
    }

    /// Returns where it belongs: `processor:loop`.
    pub(crate) fn place(&self) -> String {
        format!("{}:{}", self.member.name, self.owner)
    }

    /// Returns its names, from the shortest to the longest.
    fn names(&self) -> [String; 3] {
        let name = &self.name;
        [
            name.clone(),
            format!("{}:{name}", self.member.name),
            format!("{}:{name}", self.place()),
        ]
    }
}

/// What some processors show.
pub(crate) struct Known {
    pub(crate) all: Vec<One>,
    /// What could not be read.
    pub(crate) troubles: Vec<String>,
}

impl Known {
    /// Reads the tables of processors of a system; one that cannot be read hides no other.
    pub(crate) fn all(view: &View, members: &[Member]) -> Result<Self, AnyError> {
        let mut known = Self {
            all: Vec::new(),
            troubles: Vec::new(),
        };
        for member in members {
            if let Err(error) = known.add(view, &Arc::new(member.clone())) {
                known.troubles.push(format!("{}: {error}", member.name));
            }
        }
        if known.all.is_empty() {
            let whose = match members {
                [only] => only.name.as_str(),
                _ => "the system",
            };
            let troubles = match known.troubles.as_slice() {
                [] => "the programs publish none".into(),
                troubles => troubles.join("; "),
            };
            return Err(format!("{whose} has no variables: {troubles}").into());
        }
        Ok(known)
    }

    fn add(&mut self, view: &View, member: &Arc<Member>) -> Result<(), AnyError> {
        for variables in view.variables(member.processor())? {
            let owner = variables.name.into();
            let read = variables.table.and_then(|table| {
                let entries = table.entries();
                let ones = entries.map(|entry| One::read(member, &owner, &table, entry?));
                ones.collect::<Result<Vec<_>, _>>()
            });
            match read {
                Ok(ones) => self.all.extend(ones),
                Err(error) => {
                    let trouble = format!("{}:{owner}: {error}", member.name);
                    self.troubles.push(trouble);
                }
            }
        }
        Ok(())
    }

    pub(crate) fn tell_troubles(&self) {
        for trouble in &self.troubles {
            eprintln!("condor: {}", plain(trouble));
        }
    }

    /// Finds what a name stands for. A name that several have begins with the processor and a colon, or
    /// with the processor and the loop.
    pub(crate) fn find(&self, name: &str) -> Result<&One, String> {
        let mut found = self
            .all
            .iter()
            .filter(|one| one.names().iter().any(|it| it == name));
        match (found.next(), found.next()) {
            (Some(one), None) => Ok(one),
            (Some(one), Some(other)) => {
                let [_, on_processor, in_loop] = one.names();
                let [_, other_processor, other_loop] = other.names();
                let (one, other) = if on_processor == other_processor {
                    (in_loop, other_loop)
                } else {
                    (on_processor, other_processor)
                };
                Err(format!(
                    "several variables have the name `{name}`: write {one} or {other}"
                ))
            }
            (None, _) => Err(self.unknown(name)),
        }
    }

    /// Finds what names and patterns stand for, each once, in their order. In a pattern, `*` stands for
    /// any characters, and `?` for one.
    pub(crate) fn matching(&self, patterns: &[String]) -> Result<Vec<&One>, String> {
        let mut found: Vec<&One> = Vec::new();
        for text in patterns {
            if !text.contains(['*', '?']) {
                found.push(self.find(text)?);
                continue;
            }
            let pattern = WildMatch::new(text);
            let matches = |one: &&One| one.names().iter().any(|name| pattern.matches(name));
            let before = found.len();
            found.extend(self.all.iter().filter(matches));
            if found.len() == before {
                return Err(format!(
                    "no variable or parameter matches `{text}`; `vars list` shows all"
                ));
            }
        }
        let mut seen = BTreeSet::new();
        found.retain(|one| seen.insert(core::ptr::from_ref(*one)));
        Ok(found)
    }

    /// Returns the shortest name of each that no other variable has.
    pub(crate) fn labels(&self, chosen: &[&One]) -> Vec<String> {
        let mut counts = BTreeMap::new();
        for name in self.all.iter().flat_map(One::names) {
            *counts.entry(name).or_insert(0) += 1;
        }
        let label = |one: &&One| {
            let [name, on_processor, in_loop] = one.names();
            let unique = [name, on_processor].into_iter();
            let mut unique = unique.filter(|name| counts.get(name) == Some(&1));
            unique.next().unwrap_or(in_loop)
        };
        chosen.iter().map(label).collect()
    }

    fn unknown(&self, name: &str) -> String {
        let own = name.rsplit_once(':').map_or(name, |(_, own)| own);
        let mut text = format!(
            "there is no variable or parameter `{name}`; {}",
            nearest(own, self.all.iter().map(|one| one.name.as_str()))
        );
        for trouble in &self.troubles {
            text.extend(["; ", trouble]);
        }
        text
    }

    /// Returns the parameters that may have been meant.
    pub(crate) fn parameters_like(&self, name: &str) -> String {
        let parameters = self.all.iter().filter(|one| one.can_be_set());
        nearest(name, parameters.map(|one| one.name.as_str()))
    }
}

/// Returns the names that are most like `name`.
fn nearest<'n>(name: &str, names: impl Iterator<Item = &'n str>) -> String {
    let names: BTreeSet<&str> = names.collect();
    let mut scored: Vec<(f64, &str)> = names
        .into_iter()
        .map(|other| (strsim::jaro_winkler(name, other), other))
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let count = scored.len();
    let names: Vec<&str> = scored.iter().take(SUGGESTIONS).map(|it| it.1).collect();
    match names.as_slice() {
        [] => "there is no parameter that can be set".into(),
        names => format!(
            "of {count}, the most similar are {}; `vars list` shows all",
            names.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn the_most_similar_names_come_first() {
        let names = ["thumb.base.kp", "index.proximal.kp", "index.proximal.kv"];
        let text = nearest("index.proximl.kp", names.into_iter());
        assert!(
            text.starts_with("of 3, the most similar are index.proximal.kp,"),
            "{text}"
        );
    }
}
