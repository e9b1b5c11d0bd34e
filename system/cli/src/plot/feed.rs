//! [`PlotFeed`]: fetches what a plot wishes from a running system, or from a recording.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread;
use std::time::{Duration, Instant};

use super::choice::Choice;
use super::curve::{Sample, Wish};
use super::feed_event::{FeedEvent, gaps};
use super::file;
use super::numbers::Numbers;
use crate::recording::RecordingReader;
use condor_host::control::ControlClient;
use condor_host::error::AnyError;
use condor_host::extension::Extension;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_host::watching::{CatalogEntry, NewPrograms, Rows, VariableCatalog, float};

/// The time between two pieces of news with values.
const PIECE: Duration = Duration::from_millis(100);
/// The time between two attempts to fetch.
const AGAIN: Duration = Duration::from_secs(1);

/// A thread that fetches values. It claims nothing of a system before the first wish, and ends when
/// this is dropped, or when nobody hears its news.
#[derive(Debug)]
pub(crate) struct PlotFeed {
    wishes: Sender<Wish>,
}

impl PlotFeed {
    /// Fetches from a running system: variables, and numbers of programs of `extensions` by expressions. `tell`
    /// returns false if nobody hears it.
    pub(crate) fn start(
        directory: &SystemDirectory,
        extensions: &[&'static dyn Extension],
        tell: impl FnMut(FeedEvent) -> bool + Send + 'static,
    ) -> Self {
        let (wishes, wish_receiver) = channel();
        let (directory, extensions) = (directory.clone(), extensions.to_vec());
        thread::spawn(move || feed(&directory, &extensions, &wish_receiver, tell));
        Self { wishes }
    }

    /// Fetches from a recording. `tell` returns false if nobody hears it.
    pub(crate) fn of_file(
        reader: RecordingReader,
        tell: impl FnMut(FeedEvent) -> bool + Send + 'static,
    ) -> Self {
        let (wishes, wish_receiver) = channel();
        thread::spawn(move || file::feed(&reader, &wish_receiver, tell));
        Self { wishes }
    }

    /// Fetches this instead of what was wished before.
    pub(crate) fn wish(&self, wish: Wish) {
        // The thread ends only when nobody hears it.
        let _ = self.wishes.send(wish);
    }
}

/// The reason why values are not fetched any more.
enum End {
    /// The plot wishes other variables.
    Wished(Wish),
    /// Nobody wishes or hears anything.
    Over,
}

fn feed(
    directory: &SystemDirectory,
    extensions: &[&'static dyn Extension],
    wish_receiver: &Receiver<Wish>,
    mut tell: impl FnMut(FeedEvent) -> bool,
) {
    let Ok(mut wish) = wish_receiver.recv() else {
        return;
    };
    let mut told = String::new();
    loop {
        let next = match fetch(directory, extensions, &wish, wish_receiver, &mut tell) {
            Ok(End::Over) => return,
            Ok(End::Wished(next)) => Ok(next),
            Err(error) => {
                let text = error.to_string();
                if text != told && !tell(FeedEvent::Trouble(text.clone())) {
                    return;
                }
                told = text;
                wish_receiver.recv_timeout(AGAIN)
            }
        };
        match next {
            Ok(next) => {
                wish = next;
                told.clear();
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Fetches what is wished until something else is.
fn fetch(
    directory: &SystemDirectory,
    extensions: &[&'static dyn Extension],
    wish: &Wish,
    wish_receiver: &Receiver<Wish>,
    tell: &mut impl FnMut(FeedEvent) -> bool,
) -> Result<End, AnyError> {
    let status = ControlClient::connect(directory)?.status()?;
    let mut view = View::open(directory, status.window_bytes)?;
    view.join()?;
    let known = VariableCatalog::read(&view, &status.processors);
    let mut choice = Choice::of(&known.all, wish, &known.hint(), |one: &CatalogEntry| {
        (one.entry.unit.to_string(), one.of.labels.clone())
    });
    let mut numbers = Numbers::new(extensions, directory, &status, &view);
    choice.find_others(|name| numbers.find(name));
    if wish.panes.iter().all(Vec::is_empty) {
        known.check(&status.processors)?;
    }
    let first = choice.columns.len();
    if !choice.trouble().is_none_or(&mut *tell) {
        return Ok(End::Over);
    }
    let mut newcomers = NewPrograms::after(&known, &status.processors, &[]);
    let mut rows = Rows::of(&view, &choice.columns, 1)?;
    if !tell(FeedEvent::Chosen(choice.chosen)) {
        return Ok(End::Over);
    }
    let mut samples = Vec::new();
    // The columns of each source, and the instant of its last row.
    let mut last = BTreeMap::<usize, (Vec<usize>, u64)>::new();
    let mut told = Instant::now();
    loop {
        rows.read(|source, row| {
            let at_ns = row.released.as_ns();
            let (columns, last_ns) = last.entry(source).or_default();
            if columns.is_empty() {
                columns.extend(row.fields.iter().flat_map(|field| &field.columns));
            }
            if row.lost > 0 {
                samples.extend(gaps(columns, *last_ns));
            }
            *last_ns = at_ns;
            for (field, value) in row.values() {
                let value = float(value);
                samples.extend(field.columns.iter().map(|&curve| Sample {
                    curve,
                    at_ns,
                    value,
                }));
            }
        })?;
        // The wish may name them.
        if !newcomers.look(&view).is_empty() {
            return Ok(if samples.is_empty() || tell(FeedEvent::Samples(samples)) {
                End::Wished(wish.clone())
            } else {
                End::Over
            });
        }
        samples.extend(numbers.read(first, view.now().as_ns()));
        let mut trouble = None;
        for change in rows.changes() {
            if let Some((columns, last_ns)) = last.get(&change.source) {
                samples.extend(gaps(columns, *last_ns));
            }
            trouble = Some(change.text);
        }
        if told.elapsed() >= PIECE {
            told = Instant::now();
            let piece = core::mem::take(&mut samples);
            let is_heard = piece.is_empty() || tell(FeedEvent::Samples(piece));
            if !is_heard || !directory.is_running() {
                break;
            }
        }
        if !trouble.is_none_or(|text| tell(FeedEvent::Trouble(text))) {
            return Ok(End::Over);
        }
        match wish_receiver.try_recv() {
            Ok(wish) => return Ok(End::Wished(wish)),
            Err(TryRecvError::Disconnected) => return Ok(End::Over),
            Err(TryRecvError::Empty) => rows.pause()?,
        }
    }
    Err("the system has ended".into())
}
