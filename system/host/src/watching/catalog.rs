//! [`VariableCatalog`]: all names that there are.

use std::sync::Arc;

use condor_mbox::linux::LinuxWindow;
use condor_vars::{TableEntry, VariableTable, VariableTableError};

use super::types::Type;
use crate::control::Member;
use crate::error::{AnyError, tell};
use crate::names::{self, VariableName};
use crate::plain::plain;
use crate::view::{View, ViewError};

/// The hint that errors about names end with.
const ALL: &str = "`vars list` shows all";

/// A variable, a parameter, or a field of a published cell in a [`VariableCatalog`], with its name, its type and its
/// place.
pub struct CatalogEntry {
    /// The processor.
    pub member: Arc<Member>,
    /// The name of its loop or cell.
    pub owner: Arc<str>,
    /// The name of the variable; that of a field begins with the name of its cell and a period.
    pub name: String,
    /// The table in which it is.
    pub table: VariableTable<LinuxWindow>,
    /// The entry of the variable in that table.
    pub entry: TableEntry,
    /// The type of the variable.
    pub of: Type,
}

impl CatalogEntry {
    fn read(
        member: &Arc<Member>,
        owner: &Arc<str>,
        table: &VariableTable<LinuxWindow>,
        entry: TableEntry,
    ) -> Result<Self, VariableTableError> {
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

    /// Returns true if this entry is a field of a published cell.
    #[must_use]
    pub fn is_field(&self) -> bool {
        self.table.cell().is_some()
    }

    /// Returns true if this entry is a parameter, the only kind of entry that can be set.
    #[must_use]
    pub const fn can_be_set(&self) -> bool {
        self.entry.bounds.is_some()
    }

    /// Returns the place to which this entry belongs: `processor:loop` or `processor:cell`.
    #[must_use]
    pub fn place(&self) -> String {
        format!("{}:{}", self.member.name, self.owner)
    }
}

impl VariableName for CatalogEntry {
    fn parts(&self) -> [&str; 3] {
        [&self.member.name, &self.owner, &self.name]
    }
}

/// The variables, parameters and fields of published cells of some processors, which can be found by name.
#[derive(Default)]
pub struct VariableCatalog {
    /// All variables, parameters and fields, in the order of the processors.
    pub all: Vec<CatalogEntry>,
    /// A text for each table that could not be read, with the reason.
    pub troubles: Vec<String>,
}

impl VariableCatalog {
    /// Reads the tables of the processors in `members`, as [`read`](Self::read) does.
    ///
    /// # Errors
    /// Returns an error if there is no variable at all; the text names the tables that could not be read.
    pub fn all(view: &View, members: &[Member]) -> Result<Self, AnyError> {
        let known = Self::read(view, members);
        known.check(members)?;
        Ok(known)
    }

    /// Reads the tables of the processors in `members`. If a table cannot be read, the reason is added to
    /// [`troubles`](Self::troubles), and the other tables are read all the same.
    #[must_use]
    pub fn read(view: &View, members: &[Member]) -> Self {
        let mut known = Self::default();
        for member in members {
            if let Err(error) = known.add(view, &Arc::new(member.clone()), |_| true) {
                known.troubles.push(format!("{}: {error}", member.name));
            }
        }
        known
    }

    /// Checks that there is a variable in the tables of `members`, from which this was read.
    ///
    /// # Errors
    /// Returns an error if there is none; the text names the tables that could not be read.
    pub fn check(&self, members: &[Member]) -> Result<(), AnyError> {
        if self.all.is_empty() {
            let whose = match members {
                [only] => only.name.as_str(),
                _ => "the system",
            };
            let troubles = match self.troubles.as_slice() {
                [] => "the programs publish none".into(),
                troubles => troubles.join("; "),
            };
            return Err(format!("{whose} has no variables: {troubles}").into());
        }
        Ok(())
    }

    /// Returns the index in `columns` of the variable called `name`. Returns `None` if it is not in `columns`, or if
    /// the catalog has no such variable or several.
    #[must_use]
    pub fn column(&self, name: &str, columns: &[&CatalogEntry]) -> Option<usize> {
        let one = self.find(name).ok()?;
        columns.iter().position(|it| core::ptr::eq(*it, one))
    }

    /// Adds the variables of those loops and cells of a processor that are `wanted`.
    pub(super) fn add(
        &mut self,
        view: &View,
        member: &Arc<Member>,
        wanted: impl Fn(&str) -> bool,
    ) -> Result<(), ViewError> {
        for variables in view.variables(member.processor())? {
            if !wanted(&variables.name) {
                continue;
            }
            let owner = variables.name.into();
            let read = variables.table.and_then(|table| {
                let entries = table.entries();
                let ones = entries.map(|entry| CatalogEntry::read(member, &owner, &table, entry?));
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

    /// Prints the [`troubles`](Self::troubles) on standard error, one per line.
    pub fn tell_troubles(&self) {
        for trouble in &self.troubles {
            tell(plain(trouble));
        }
    }

    /// Finds the variable, parameter or field called `name`. If several have the same name of their own, `name` must be
    /// `processor:name` or `processor:loop:name`.
    ///
    /// # Errors
    /// Returns an error if no variable has the name, with similar names, or if several variables have it.
    pub fn find(&self, name: &str) -> Result<&CatalogEntry, String> {
        names::find(&self.all, name, &self.hint())
    }

    /// Finds the variables that `patterns` name, in the order of `patterns`. Each variable is returned once. In a
    /// pattern, `*` stands for any characters, and `?` for one character.
    ///
    /// # Errors
    /// Returns an error if a name stands for no variable or for several, or if a pattern matches nothing; the
    /// text names it.
    pub fn matching(&self, patterns: &[String]) -> Result<Vec<&CatalogEntry>, String> {
        names::matching(&self.all, patterns, &self.hint())
    }

    /// Returns, for each entry in `chosen`, the shortest of its names that no other entry of the catalog has.
    #[must_use]
    pub fn labels(&self, chosen: &[&CatalogEntry]) -> Vec<String> {
        names::labels(&self.all, chosen)
    }

    /// Returns the text with which errors about names end: the command that shows all names, and the tables that could
    /// not be read.
    #[must_use]
    pub fn hint(&self) -> String {
        let mut text = format!("; {ALL}");
        for trouble in &self.troubles {
            text.extend(["; ", trouble]);
        }
        text
    }

    /// Finds the parameter called `name`, which is written as for [`find`](Self::find).
    ///
    /// # Errors
    /// Returns an error if no variable or several variables have the name, or if the variable is not a
    /// parameter.
    pub fn parameter(&self, name: &str) -> Result<&CatalogEntry, String> {
        let one = self.find(name)?;
        if one.can_be_set() {
            return Ok(one);
        }
        let others = self.parameters_like(name);
        Err(format!(
            "`{name}` is not a parameter and cannot be set; {others}"
        ))
    }

    /// Returns the parameters that may have been meant.
    fn parameters_like(&self, name: &str) -> String {
        let parameters = self.all.iter().filter(|one| one.can_be_set());
        match names::nearest(name, parameters) {
            Some(nearest) => format!("{nearest}; {ALL}"),
            None => "there is no parameter that can be set".into(),
        }
    }
}
