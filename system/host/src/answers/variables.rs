//! The answers to `condor vars list` and `condor vars get`: variables with their properties and values.

use std::collections::BTreeSet;

use condor_vars::AnyValue;
use serde::Serialize;
use serde_json::Value as Json;

use crate::control::SystemStatus;
use crate::error::AnyError;
use crate::view::View;
use crate::watching::{CatalogEntry, Clients, VariableCatalog, present};

/// The report that `condor vars list --json` prints on one variable, one parameter or one field of a published cell. It
/// serializes to a JSON object. [`variable`] makes it.
#[derive(Serialize)]
pub struct Variable<'s> {
    processor: &'s str,
    #[serde(rename = "loop", skip_serializing_if = "Option::is_none")]
    of_loop: Option<&'s str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cell: Option<&'s str>,
    name: &'s str,
    #[serde(rename = "type")]
    type_name: String,
    unit: &'s str,
    about: &'s str,
    can_be_set: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    bounds: Option<[Json; 2]>,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    labels: &'s [String],
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<Json>,
}

/// Returns a JSON array with an object for each variable, parameter and field of a published cell.
///
/// If `names` is empty, these are all of the processors in `status`, as `condor vars list --json` prints them.
/// Variables have no value then: only parameters and fields are read. Otherwise they are those in `names`, in that
/// order, as `condor vars get --json` prints them, each with its present value.
///
/// # Errors
/// Returns an error if there are no variables, if a name is unknown or ambiguous, or, with `names`, if a value cannot
/// be read; the text says which one.
pub fn variables(
    status: &SystemStatus,
    view: &View,
    clients: &mut Clients<'_>,
    names: &[String],
) -> Result<Json, AnyError> {
    let mut known = VariableCatalog::all(view, &status.processors)?;
    let (chosen, values): (Vec<_>, _) = if names.is_empty() {
        let values = all_values(&mut known, clients);
        (known.all.iter().collect(), values)
    } else {
        let chosen = names.iter().map(|name| known.find(name));
        let chosen = chosen.collect::<Result<Vec<_>, _>>()?;
        let values = values(clients, &chosen)?;
        (chosen, values)
    };
    let rows = chosen.into_iter().zip(values);
    let rows: Vec<_> = rows.map(|(one, value)| variable(one, value)).collect();
    Ok(serde_json::to_value(rows)?)
}

/// Returns the value of each entry of `known`, in that order. The value is `None` for a variable, which has values only
/// in rows, and for a parameter or field that cannot be read. If a parameter cannot be read, the reason is added to
/// [`VariableCatalog::troubles`], and no other parameter of that processor is asked for.
pub fn all_values(known: &mut VariableCatalog, clients: &mut Clients<'_>) -> Vec<Option<AnyValue>> {
    let (mut values, mut silent) = (Vec::new(), BTreeSet::new());
    for one in &known.all {
        let is_silent = one.can_be_set() && silent.contains(&one.member.number);
        let value = (!is_silent).then(|| clients.value(one));
        // A cell of which nothing has been published yet has no value.
        if one.can_be_set()
            && let Some(Err(error)) = &value
        {
            silent.insert(one.member.number);
            known.troubles.push(format!("{}: {error}", one.place()));
        }
        values.push(value.and_then(Result::ok).flatten());
    }
    values
}

/// Returns the present value of each entry of `chosen`, in that order. Variables have the values of the next row of
/// their loop. The value is `None` only if the bytes of a cell are too few for its field.
///
/// # Errors
/// Returns an error if a value cannot be read; the text names the variable or the loop.
pub fn values(
    clients: &mut Clients<'_>,
    chosen: &[&CatalogEntry],
) -> Result<Vec<Option<AnyValue>>, AnyError> {
    let mut values = present(clients, chosen)?;
    for (one, value) in chosen.iter().zip(&mut values) {
        let asked = clients.value(one);
        let asked = asked.map_err(|error| format!("{}: {error}", one.place()))?;
        *value = value.or(asked);
    }
    Ok(values)
}

/// Makes the report on the entry `one` of a catalog. `value` is its present value; with `None`, the report has no
/// value.
#[must_use]
pub fn variable(one: &CatalogEntry, value: Option<AnyValue>) -> Variable<'_> {
    let owner = Some(&*one.owner);
    let (of_loop, cell) = if one.is_field() {
        (None, owner)
    } else {
        (owner, None)
    };
    Variable {
        processor: &one.member.name,
        of_loop,
        cell,
        name: &one.name,
        type_name: one.of.to_string(),
        unit: &one.entry.unit,
        about: &one.entry.about,
        can_be_set: one.can_be_set(),
        bounds: (one.entry.bounds).map(|bounds| bounds.map(|bound| one.of.json(bound))),
        labels: &one.of.labels,
        value: value.map(|value| one.of.json(value)),
    }
}
