//! Checks that several parts of a plant share.

use crate::number::{NumberError, Requirement, check, finite};

pub(super) fn all_finite<'a>(
    what: &'static str,
    values: impl IntoIterator<Item = &'a f64>,
) -> Result<(), NumberError> {
    values
        .into_iter()
        .try_for_each(|&value| finite(what, value))
}

/// Refuses a range whose ends are not in order.
pub(super) fn ordered(what: &'static str, (low, high): (f64, f64)) -> Result<(), NumberError> {
    finite(what, low)?;
    check(what, high, Requirement::Above(low))
}
