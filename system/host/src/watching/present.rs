//! A single look at variables.

use std::time::{Duration, Instant};

use condor_vars::AnyValue;

use super::rows::LATER;
use super::{CatalogEntry, Clients, RowSource, Rows};
use crate::error::AnyError;

/// The shortest wait for rows before a loop counts as silent.
const SILENCE: Duration = Duration::from_secs(2);

/// Returns the time to wait for a row from each of `sources` before a loop counts as silent: four rows of the slowest,
/// and at least 2 s. There is a row every `every` ticks.
#[must_use]
pub fn patience(sources: &[RowSource], every: u32) -> Duration {
    let periods = sources.iter().map(|source| source.period_s(every));
    let several = Duration::try_from_secs_f64(4.0 * periods.fold(0.0, f64::max));
    several.unwrap_or(Duration::MAX).max(SILENCE)
}

/// Returns the text of the error that the loops in `silent` write no rows.
#[must_use]
pub fn silence(silent: &[String]) -> String {
    let silent = silent.join(", ");
    format!("{silent}: the loop writes no rows; `top` shows whether it is enabled")
}

/// Returns the present value of each variable in `chosen`, in that order, from the next row of its loop. The value is
/// `None` for parameters and fields, which [`Clients::value`] reads.
///
/// # Errors
/// Returns an error if a loop writes no rows, cannot be asked, or has ended; the text names the loop.
pub fn present(
    clients: &mut Clients<'_>,
    chosen: &[&CatalogEntry],
) -> Result<Vec<Option<AnyValue>>, AnyError> {
    let mut values = vec![None; chosen.len()];
    let chosen = values.iter_mut().zip(chosen.iter().copied());
    let (mut places, columns): (Vec<_>, Vec<_>) = chosen
        .filter(|(_, one)| !one.is_field() && !one.can_be_set())
        .unzip();
    if columns.is_empty() {
        return Ok(values);
    }
    let mut rows = Rows::with(clients.take(), &columns, 1)?;
    let mut look = || {
        let begun = Instant::now();
        let patience = patience(&rows.sources, 1);
        loop {
            rows.read(|_, row| {
                for (field, value) in row.values() {
                    for column in &field.columns {
                        if let Some(place) = places.get_mut(*column) {
                            **place = Some(value);
                        }
                    }
                }
            })?;
            // A program that has ended or does not run has no values.
            if let Some(change) = rows.changes().into_iter().next() {
                // Nobody waits for its rows here.
                let text = change.text.strip_suffix(LATER).unwrap_or(&change.text);
                return Err(format!("{text}; `ps` shows whether it runs").into());
            }
            if rows.sources.iter().all(|source| source.rows > 0) {
                return Ok(());
            }
            if begun.elapsed() >= patience {
                return Err(silence(&rows.silent()).into());
            }
            rows.pause()?;
        }
    };
    let looked: Result<(), AnyError> = look();
    *clients = rows.end();
    looked.map(|()| values)
}
