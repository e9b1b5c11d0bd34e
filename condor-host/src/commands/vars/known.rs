//! [`Known`]: all names that there are.

use std::collections::BTreeSet;
use std::rc::Rc;

use condor_mbox::linux::LinuxWindow;
use condor_vars::{Entry, Table, TableError};

use super::value::Type;
use crate::control::Member;
use crate::error::AnyError;
use crate::plain::plain;
use crate::view::View;

/// How many names are suggested.
const SUGGESTIONS: usize = 5;

/// A variable, a parameter, or a field of a cell.
pub(super) struct One<'s> {
    pub(super) member: &'s Member,
    /// The name of its loop or cell.
    pub(super) owner: Rc<str>,
    pub(super) name: String,
    pub(super) table: Table<LinuxWindow>,
    pub(super) entry: Entry,
    pub(super) of: Type,
}

impl<'s> One<'s> {
    fn read(
        member: &'s Member,
        owner: &Rc<str>,
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
            member,
            owner: owner.clone(),
            name,
            table: table.clone(),
            entry,
            of: Type { kind, labels },
        })
    }

    pub(super) fn is_field(&self) -> bool {
        self.table.cell().is_some()
    }

    pub(super) const fn can_be_set(&self) -> bool {
        self.entry.bounds.is_some()
    }

    /// Returns where it belongs: `processor:loop`.
    pub(super) fn place(&self) -> String {
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
pub(super) struct Known<'s> {
    pub(super) all: Vec<One<'s>>,
    /// What could not be read.
    pub(super) troubles: Vec<String>,
}

impl<'s> Known<'s> {
    /// Reads the tables of processors of a system; one that cannot be read hides no other.
    pub(super) fn all(view: &View, members: &'s [Member]) -> Result<Self, AnyError> {
        let mut known = Self {
            all: Vec::new(),
            troubles: Vec::new(),
        };
        for member in members {
            if let Err(error) = known.add(view, member) {
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

    fn add(&mut self, view: &View, member: &'s Member) -> Result<(), AnyError> {
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

    pub(super) fn tell_troubles(&self) {
        for trouble in &self.troubles {
            eprintln!("condor: {}", plain(trouble));
        }
    }

    /// Finds what a name stands for. A name that several have begins with the processor and a colon, or
    /// with the processor and the loop.
    pub(super) fn find(&self, name: &str) -> Result<&One<'s>, String> {
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
    pub(super) fn parameters_like(&self, name: &str) -> String {
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
