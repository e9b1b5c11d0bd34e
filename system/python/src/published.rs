//! Published cells: a struct that a program publishes as a whole.

use std::collections::BTreeSet;

use condor_vars::Cell;

use crate::failure::Failure;
use crate::system_worker::WorkerState;
use crate::values::PythonValue;

/// A value of a published cell: `(sequence number, [(field, value)])`.
pub(crate) type Latest = (u32, Vec<(String, PythonValue)>);

impl WorkerState<'_> {
    /// Returns the latest value of the published cell `name`; all fields are of one instant.
    pub(crate) fn published(&self, name: &str) -> Result<Latest, Failure> {
        let known = self.known()?;
        let fields = known.all.iter().filter(|one| one.is_field());
        let own: Vec<_> = fields
            .clone()
            .filter(|one| name == &*one.owner || name == one.place())
            .collect();
        let places: BTreeSet<_> = own.iter().map(|one| one.place()).collect();
        let places: Vec<_> = places.into_iter().collect();
        let Some(first) = own.first().filter(|_| places.len() == 1) else {
            if !own.is_empty() {
                let places = places.join(" or ");
                return Err(Failure::not_found(format!(
                    "several cells have the name `{name}`: write {places}"
                )));
            }
            let all: BTreeSet<_> = fields
                .map(condor_host::watching::CatalogEntry::place)
                .collect();
            let all: Vec<_> = all.into_iter().collect();
            let all = all.join(", ");
            return Err(Failure::not_found(format!(
                "there is no published cell `{name}`; there are {all}"
            )));
        };
        let region = self.view.region(first.member.processor())?;
        let cell = Cell::open(&region, first.table.offset())?;
        let mut bytes = vec![0; cell.bytes()];
        let sequence = cell.read(&mut bytes)?;
        let values = own.iter().filter_map(|one| {
            let value = PythonValue::of(&one.of, one.entry.of_cell(&bytes)?);
            Some((one.entry.name.to_string(), value))
        });
        Ok((sequence, values.collect()))
    }
}
