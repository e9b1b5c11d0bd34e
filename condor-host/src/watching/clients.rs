//! [`Clients`]: asks the loops of several processors.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::Duration;

use condor_mbox::linux::LinuxWindow;
use condor_vars::{Cell, Client, RequestError, Value};

use super::known::One;
use crate::control::Member;
use crate::error::AnyError;
use crate::view::{Post, View, ViewError};

/// The time that a loop has to answer.
pub(super) const ANSWER: Duration = Duration::from_secs(2);

/// A client for each processor that was asked.
pub(crate) struct Clients<'v> {
    view: &'v View,
    all: BTreeMap<u8, Client<'v, Post, LinuxWindow>>,
}

impl<'v> Clients<'v> {
    pub(crate) const fn new(view: &'v View) -> Self {
        Self {
            view,
            all: BTreeMap::new(),
        }
    }

    /// Returns the client that asks the loops of a processor.
    pub(crate) fn of(
        &mut self,
        member: &Member,
    ) -> Result<&mut Client<'v, Post, LinuxWindow>, ViewError> {
        let client = match self.all.entry(member.number) {
            Entry::Occupied(occupied) => occupied.into_mut(),
            Entry::Vacant(vacant) => vacant.insert(self.view.client(member.processor())?),
        };
        Ok(client)
    }

    /// Returns the value of a parameter or of a field of a cell; `None` for a variable, whose values are
    /// only in rows.
    pub(crate) fn value(&mut self, one: &One) -> Result<Option<Value>, AnyError> {
        if one.is_field() {
            let region = self.view.region(one.member.processor())?;
            let cell = Cell::open(&region, one.table.offset())?;
            let mut bytes = vec![0; cell.bytes()];
            cell.read(&mut bytes)?;
            return Ok(one.entry.of_cell(&bytes));
        }
        if !one.can_be_set() {
            return Ok(None);
        }
        let value = self.of(&one.member)?.get(&one.table, &one.entry, ANSWER)?;
        Ok(Some(value))
    }

    /// Sets a parameter to `new` if it is `from`, or if it is still what it is now. Returns the value
    /// that it had.
    ///
    /// The owner checks the value. An error calls the parameter `name`, as the user does.
    pub(crate) fn set(
        &mut self,
        name: &str,
        one: &One,
        from: Option<Value>,
        new: Value,
    ) -> Result<Value, AnyError> {
        let client = self.of(&one.member)?;
        let before = match from {
            Some(from) => from,
            None => client.get(&one.table, &one.entry, ANSWER)?,
        };
        let set = client.set(&one.table, &one.entry, before, new, ANSWER);
        set.map_err(|error| refusal(name, one, new, error))?;
        Ok(before)
    }
}

/// Says why a parameter was not set to `new`.
fn refusal(name: &str, one: &One, new: Value, error: RequestError) -> String {
    let text = |value| one.of.text(value);
    match error {
        RequestError::OutOfBounds { least, greatest } => {
            let (least, greatest) = (text(least), text(greatest));
            let range = format!("{least} to {greatest} {}", one.entry.unit);
            format!(
                "`{name}` must be from {}, not {}",
                range.trim_end(),
                text(new)
            )
        }
        RequestError::Conflict { present } => {
            let present = text(present);
            format!(
                "`{name}` was not set: its present value is {present}, so another program has set it"
            )
        }
        error => format!("`{name}` was not set: {error}"),
    }
}
