//! Fetches what a plot wishes from a recording.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::Receiver;

use super::choice::Choice;
use super::curve::{Sample, Variable, Wish};
use super::feed_event::{FeedEvent, gaps};
use crate::recording::{Column, RecordingError, RecordingReader};
use condor_host::names::VariableName;
use condor_host::watching::float;

/// The number of values after which a plot hears of them.
const PIECE: usize = 50_000;

/// The reason why reading has stopped.
enum Stop {
    /// Nobody hears it.
    Unheard,
    Failed(RecordingError),
}

impl From<RecordingError> for Stop {
    fn from(error: RecordingError) -> Self {
        Self::Failed(error)
    }
}

/// Reads what is wished until nobody wishes or hears anything.
pub(super) fn feed(
    reader: &RecordingReader,
    wish_receiver: &Receiver<Wish>,
    mut tell: impl FnMut(FeedEvent) -> bool,
) {
    let mut former = Vec::new();
    while let Ok(mut wish) = wish_receiver.recv() {
        // Only the latest counts.
        while let Ok(later) = wish_receiver.try_recv() {
            wish = later;
        }
        match read(reader, &wish, &mut former, &mut tell) {
            Ok(()) => {}
            Err(Stop::Failed(error)) if tell(FeedEvent::Trouble(error.to_string())) => {}
            Err(_) => return,
        }
    }
}

/// Reads all values of the variables that a wish names. A plot keeps those of the `former` ones.
fn read(
    reader: &RecordingReader,
    wish: &Wish,
    former: &mut Vec<Variable>,
    tell: &mut impl FnMut(FeedEvent) -> bool,
) -> Result<(), Stop> {
    let choice = Choice::of(reader.all(), wish, "", |column: &Column| {
        let variable = &column.variable;
        (variable.unit.clone(), variable.labels.clone())
    });
    if !choice.trouble().is_none_or(&mut *tell) {
        return Err(Stop::Unheard);
    }
    let known: BTreeSet<_> = former.iter().map(VariableName::parts).collect();
    let mut curves = BTreeMap::<usize, Vec<(usize, usize)>>::new();
    let columns = choice.columns.iter().zip(&choice.chosen.variables);
    for (curve, (column, variable)) in columns.enumerate() {
        if !known.contains(&variable.parts()) {
            let of_source = curves.entry(column.source).or_default();
            of_source.push((curve, column.field));
        }
    }
    former.clone_from(&choice.chosen.variables);
    if !tell(FeedEvent::Chosen(choice.chosen)) {
        return Err(Stop::Unheard);
    }
    let sources: Vec<usize> = curves.keys().copied().collect();
    let mut samples = Vec::new();
    // The instant and the tick of the last row of each source.
    let mut last = BTreeMap::<usize, (u64, u64)>::new();
    reader.rows(&sources, reader.span(), |source, at_ns, row| {
        let Some(of_source) = curves.get(&source) else {
            return Ok(());
        };
        let head = row.head();
        if let Some((last_ns, last_tick)) = last.insert(source, (at_ns, head.tick))
            && (head.lost > 0 || head.tick <= last_tick)
        {
            let curves: Vec<usize> = of_source.iter().map(|it| it.0).collect();
            samples.extend(gaps(&curves, last_ns));
        }
        for (curve, field) in of_source {
            if let Some(value) = row.value(*field) {
                samples.push(Sample {
                    curve: *curve,
                    at_ns,
                    value: float(value),
                });
            }
        }
        let is_heard =
            samples.len() < PIECE || tell(FeedEvent::Samples(core::mem::take(&mut samples)));
        if is_heard { Ok(()) } else { Err(Stop::Unheard) }
    })?;
    if tell(FeedEvent::Samples(samples)) {
        Ok(())
    } else {
        Err(Stop::Unheard)
    }
}
