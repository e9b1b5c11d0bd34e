//! [`FeedEvent`]: what a plot hears of the variables that it wishes.

use super::curve::{ChosenCurves, Sample};

/// A message from a feed to its plot.
#[derive(Debug)]
pub(crate) enum FeedEvent {
    /// The curves that the latest wish names.
    Chosen(ChosenCurves),
    Samples(Vec<Sample>),
    /// The reason why values are missing, all or some.
    Trouble(String),
}

/// Returns a gap for each curve.
pub(super) fn gaps(curves: &[usize], at_ns: u64) -> impl Iterator<Item = Sample> {
    curves.iter().map(move |&curve| Sample {
        curve,
        at_ns,
        value: f64::NAN,
    })
}
