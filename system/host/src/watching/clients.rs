//! [`Clients`]: requests to the loops of several processors.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::time::Duration;

use condor_mbox::linux::LinuxWindow;
use condor_vars::{AnyValue, Cell, RequestError, VariableClient};

use super::catalog::CatalogEntry;
use crate::control::Member;
use crate::error::AnyError;
use crate::view::{Post, View, ViewError};

/// The time that a loop has to answer, unless somebody has chosen another one.
const ANSWER: Duration = Duration::from_secs(2);

/// The requests of a visitor to the loops of all processors: it gets and sets parameters, and reads fields of published
/// cells. A loop has 2 s to answer, unless [`set_timeout`](Self::set_timeout) sets another time.
///
/// Each processor that is asked costs a block of the visitor's own memory, which is never returned.
pub struct Clients<'v> {
    view: &'v View,
    all: BTreeMap<u8, VariableClient<'v, Post, LinuxWindow>>,
    answer: Duration,
}

/// The reason why a parameter was not set, as a text for people, with the error of the request.
#[derive(Debug, thiserror::Error)]
#[error("{text}")]
pub struct SetError {
    text: String,
    /// The error of the request.
    pub source: RequestError,
}

impl<'v> Clients<'v> {
    /// Makes the clients of the visitor `view`, which must have [joined](View::join) before the first request.
    #[must_use]
    pub const fn new(view: &'v View) -> Self {
        Self {
            view,
            all: BTreeMap::new(),
            answer: ANSWER,
        }
    }

    /// Sets the time that a loop has to answer each later request.
    pub const fn set_timeout(&mut self, answer: Duration) {
        self.answer = answer;
    }

    /// Takes what this has of the visitor's memory, and leaves clients that have asked nobody yet.
    pub(crate) fn take(&mut self) -> Self {
        let mut left = Self::new(self.view);
        left.answer = self.answer;
        core::mem::replace(self, left)
    }

    pub(super) const fn view(&self) -> &'v View {
        self.view
    }

    pub(super) const fn timeout(&self) -> Duration {
        self.answer
    }

    /// Returns the client that asks the loops of a processor.
    pub(super) fn of(
        &mut self,
        member: &Member,
    ) -> Result<&mut VariableClient<'v, Post, LinuxWindow>, ViewError> {
        let client = match self.all.entry(member.number) {
            Entry::Occupied(occupied) => occupied.into_mut(),
            Entry::Vacant(vacant) => vacant.insert(self.view.client(member.processor())?),
        };
        Ok(client)
    }

    /// Returns the present value of the parameter or field `one`. Returns `None` for a variable, whose values are only
    /// in rows.
    ///
    /// # Errors
    /// Returns [`RequestError`] if a parameter cannot be read; [`CellError`](condor_vars::CellError) if a field
    /// cannot be read; [`ViewError`] if the memory of the processor cannot be accessed.
    pub fn value(&mut self, one: &CatalogEntry) -> Result<Option<AnyValue>, AnyError> {
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
        let answer = self.answer;
        let value = self.of(&one.member)?.get(&one.table, &one.entry, answer)?;
        Ok(Some(value))
    }

    /// Returns the value with which the parameter `one` began when its program was started: that of the description.
    ///
    /// # Errors
    /// Returns [`RequestError`] if the parameter cannot be read, or `one` is none; [`ViewError`] if the memory of the
    /// processor cannot be accessed.
    pub fn initial(&mut self, one: &CatalogEntry) -> Result<AnyValue, AnyError> {
        let answer = self.answer;
        let client = self.of(&one.member)?;
        Ok(client.initial(&one.table, &one.entry, answer)?)
    }

    /// Sets the parameter `one` to `new`, and returns its previous value. The parameter is set only if its value is
    /// `from`; if `from` is `None`, only if no other program sets it during this call. The program that owns the
    /// parameter checks the new value.
    ///
    /// # Errors
    /// Returns [`SetError`] if the owner refuses the value or does not answer; its text calls the parameter `name`, as
    /// the user does. Returns [`RequestError`] if the present value cannot be read; [`ViewError`] if the memory of the
    /// processor cannot be accessed.
    pub fn set(
        &mut self,
        name: &str,
        one: &CatalogEntry,
        from: Option<AnyValue>,
        new: AnyValue,
    ) -> Result<AnyValue, AnyError> {
        let answer = self.answer;
        let client = self.of(&one.member)?;
        let before = match from {
            Some(from) => from,
            None => client.get(&one.table, &one.entry, answer)?,
        };
        let set = client.set(&one.table, &one.entry, before, new, answer);
        set.map_err(|error| refusal(name, one, new, error))?;
        Ok(before)
    }
}

/// Says why a parameter was not set to `new`.
fn refusal(name: &str, one: &CatalogEntry, new: AnyValue, source: RequestError) -> SetError {
    let text = |value| one.of.text(value);
    let text = match &source {
        &RequestError::OutOfBounds { least, greatest } => {
            let (least, greatest) = (text(least), text(greatest));
            let range = format!("{least} to {greatest} {}", one.entry.unit);
            format!(
                "`{name}` must be from {}, not {}",
                range.trim_end(),
                text(new)
            )
        }
        &RequestError::Conflict { present } => {
            let present = text(present);
            format!(
                "`{name}` was not set: its present value is {present}, so another program has set it; try \
                 again from that value"
            )
        }
        error => format!("`{name}` was not set: {error}"),
    };
    SetError { text, source }
}
