//! [`Plot`]: all that a plot shows.

use core::fmt::Write as _;
use core::time::Duration;

use serde::{Deserialize, Serialize};
use tui_input::Input;

use super::curve::{ChosenCurves, Curve, Pane, Range, Sample, Wish};
use super::feed_event::FeedEvent;
use super::figure::Figure;
use super::history::History;
use super::trigger::{Condition, Trigger};
use condor_host::names::VariableName as _;

/// The shortest and the longest time that is seen at once.
pub(super) const SPANS_NS: [u64; 2] = [1_000_000, 1_800_000_000_000];
/// The part of the time that is before the instant of a trigger: one in so many.
const BEFORE: u64 = 4;
/// The part of the time, or of a range of values, by which a key moves.
const MOVE: f64 = 0.125;

/// The prompt in front of the plot, mostly a text that is being typed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Prompt {
    /// The names of the pane in focus.
    Names,
    /// The names of a further pane.
    NewPane,
    /// The condition of the trigger.
    Trigger,
    /// Nothing is typed: help shows the keys.
    Help,
}

/// The part of the screen that the robot has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum RobotPane {
    Hidden,
    Beside,
    Alone,
}

/// The number of curves with which it begins.
const FIRST: usize = 4;

/// The way of a plot to the variables that it shows by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beginning {
    /// No person has looked.
    Unseen,
    /// Nothing is chosen, and no names are known yet.
    AwaitsNames,
    Over,
}

/// Plots of variables in several panes, with one axis of time.
#[derive(Debug)]
pub(crate) struct Plot {
    pub(crate) curves: Vec<Curve>,
    pub(crate) panes: Vec<Pane>,
    pub(crate) focus: usize,
    pub(crate) span_ns: u64,
    /// The end of the time that is seen, and 0 on the axis of time, if time does not go on.
    held: Option<(u64, u64)>,
    pub(crate) cursor_ns: Option<u64>,
    /// The instant that is 0 on the axis of time, such as the beginning of a recording; by default the newest one.
    pub(crate) zero_ns: Option<u64>,
    trigger: Option<ArmedTrigger>,
    pub(crate) figure: Option<Figure>,
    pub(crate) place: RobotPane,
    pub(crate) prompt: Option<Prompt>,
    pub(crate) typed: Input,
    /// The names that may be typed.
    pub(crate) known: Vec<String>,
    beginning: Beginning,
    /// The description of the last failure, until the next key. It is drawn with the text that is typed, or
    /// otherwise by the owner of the plot.
    pub(crate) notice: Option<String>,
    /// Whether colours distinguish curves; letters and widths of lines do so always.
    pub(crate) has_colors: bool,
}

/// A trigger with the instants at which it fired.
#[derive(Debug)]
struct ArmedTrigger {
    trigger: Trigger,
    curve: Option<usize>,
    /// The instant that is shown, once it is all there.
    shown_ns: Option<u64>,
    /// An instant that is not all there yet.
    coming_ns: Option<u64>,
}

impl Plot {
    pub(crate) fn new(span: Duration, figure: Option<Figure>, has_colors: bool) -> Self {
        let span_ns = u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
        let [shortest, longest] = SPANS_NS;
        Self {
            curves: Vec::new(),
            panes: vec![Pane::new(Vec::new())],
            focus: 0,
            span_ns: span_ns.clamp(shortest, longest),
            held: None,
            cursor_ns: None,
            zero_ns: None,
            trigger: None,
            figure,
            place: RobotPane::Hidden,
            prompt: None,
            typed: Input::default(),
            known: Vec::new(),
            beginning: Beginning::Unseen,
            notice: None,
            has_colors,
        }
    }

    /// Returns the names of all variables to fetch.
    pub(crate) fn wish(&self) -> Wish {
        let mut besides: Vec<String> = Vec::new();
        if let Some(armed) = &self.trigger {
            besides.push(armed.trigger.condition.name.clone());
        }
        if self.place != RobotPane::Hidden
            && let Some(figure) = &self.figure
        {
            besides.extend(figure.variables().map(String::from));
        }
        Wish {
            panes: self.panes.iter().map(|pane| pane.names.clone()).collect(),
            besides,
        }
    }

    /// Takes over the curves that were chosen. Those that were there before keep their values.
    pub(crate) fn choose(&mut self, chosen: ChosenCurves) {
        let mut former = core::mem::take(&mut self.curves);
        self.curves = chosen
            .variables
            .into_iter()
            .map(|variable| {
                let place = former.iter().position(|it| it.variable == variable);
                let history = place.map(|place| former.swap_remove(place).history);
                Curve {
                    variable,
                    history: history.unwrap_or_default(),
                }
            })
            .collect();
        self.known = chosen.known;
        for (pane, curves) in self.panes.iter_mut().zip(chosen.panes) {
            pane.curves = curves;
        }
        // Values that were not fetched meanwhile are not known.
        for curve in &mut self.curves {
            if let Some(newest) = curve.history.newest_ns() {
                curve.history.push(newest, f64::NAN);
            }
        }
        self.find_names();
    }

    /// Asks for values, when a person first looks; returns true if it does. If nothing has been chosen, it also shows
    /// the robot where there `is_room`.
    pub(crate) fn begin(&mut self, is_room: bool) -> bool {
        if self.beginning != Beginning::Unseen {
            return false;
        }
        self.beginning = if self.panes.iter().all(|pane| pane.names.is_empty()) {
            Beginning::AwaitsNames
        } else {
            Beginning::Over
        };
        if self.beginning == Beginning::AwaitsNames && is_room && self.figure.is_some() {
            self.show_robot(false);
        }
        true
    }

    /// Chooses the positions that are named first, or any variables, once names are known; returns true if it does.
    pub(crate) fn choose_first(&mut self) -> bool {
        if self.known.is_empty() || self.beginning != Beginning::AwaitsNames {
            return false;
        }
        self.beginning = Beginning::Over;
        let Some(pane) = self.panes.first_mut().filter(|it| it.names.is_empty()) else {
            return false;
        };
        let is_position = |name: &&String| name.ends_with(".position");
        let positions = self.known.iter().filter(is_position);
        pane.names = positions.take(FIRST).cloned().collect();
        if pane.names.is_empty() {
            pane.names = self.known.iter().take(FIRST).cloned().collect();
        }
        true
    }

    /// Takes what came.
    pub(crate) fn hear(&mut self, news: FeedEvent) {
        match news {
            FeedEvent::Chosen(chosen) => self.choose(chosen),
            FeedEvent::Samples(samples) => self.take(&samples),
            FeedEvent::Trouble(text) => self.notice = Some(text),
        }
    }

    fn find_names(&mut self) {
        if let Some(armed) = &mut self.trigger {
            let name = &armed.trigger.condition.name;
            let mut curves = self.curves.iter();
            armed.curve = curves.position(|it| it.variable.is_called(name));
        }
        if let Some(figure) = &mut self.figure {
            figure.find(&self.curves);
        }
    }

    /// Takes values, those of each curve in the order of time.
    pub(crate) fn take(&mut self, samples: &[Sample]) {
        for sample in samples {
            let Some(curve) = self.curves.get_mut(sample.curve) else {
                continue;
            };
            curve.history.push(sample.at_ns, sample.value);
            if let Some(figure) = &mut self.figure {
                figure.take(sample);
            }
            if let Some(armed) = &mut self.trigger
                && armed.curve == Some(sample.curve)
            {
                armed.take(sample, self.span_ns);
            }
        }
        if let (Some(newest), Some(armed)) = (self.newest_ns(), &mut self.trigger) {
            armed.look(newest, self.span_ns);
        }
    }

    pub(crate) fn newest_ns(&self) -> Option<u64> {
        let newest = self.curves.iter();
        newest.filter_map(|curve| curve.history.newest_ns()).max()
    }

    /// Returns the end of the time that is seen, and 0 on the axis of time: the instant of the trigger,
    /// or the newest one.
    pub(crate) fn end_and_zero_ns(&self) -> (u64, u64) {
        let newest = self.newest_ns().unwrap_or(0);
        let shown = self.trigger.as_ref().and_then(|armed| armed.shown_ns);
        let following = shown.map_or(newest, |shown| shown.saturating_add(after(self.span_ns)));
        let (end, zero) = self.held.unwrap_or((following, newest));
        (end, shown.or(self.zero_ns).unwrap_or(zero))
    }

    fn hold(&mut self, end_ns: u64) {
        let zero = self.end_and_zero_ns().1;
        self.held = Some((end_ns, zero));
    }

    pub(crate) const fn is_held(&self) -> bool {
        self.held.is_some()
    }

    /// Returns the instant whose values are told: that of the cursor, or the end of what is seen.
    pub(crate) fn told_ns(&self) -> u64 {
        self.cursor_ns.unwrap_or(self.end_and_zero_ns().0)
    }

    /// Stops what is seen, or lets it go on, without a cursor.
    pub(crate) fn pause(&mut self) {
        match self.held {
            Some(_) => self.follow(),
            None => self.hold(self.end_and_zero_ns().0),
        }
    }

    /// Shows the newest values again, and goes on.
    pub(crate) fn follow(&mut self) {
        (self.held, self.cursor_ns) = (None, None);
    }

    /// Goes back in time, or on with a number above 0; at the newest value it goes on by itself.
    pub(crate) fn pan(&mut self, steps: i32) {
        let newest = self.newest_ns().unwrap_or(0);
        let to = moved(self.end_and_zero_ns().0, self.span_ns, steps);
        if to >= newest {
            self.held = None;
        } else {
            self.hold(to);
        }
    }

    /// Shows less time, or more with a number above 0, around the cursor or up to the same end.
    pub(crate) fn zoom(&mut self, steps: i32) {
        let factors = [1, 2, 5].map(|factor| (0..13).map(move |power| factor * 10_u64.pow(power)));
        let [shortest, longest] = SPANS_NS;
        let mut spans: Vec<u64> = factors.into_iter().flatten().collect();
        spans.retain(|span| (shortest..=longest).contains(span));
        spans.sort_unstable();
        let now = self.span_ns;
        let to = if steps > 0 {
            spans.into_iter().find(|span| *span > now)
        } else {
            spans.into_iter().rfind(|span| *span < now)
        };
        let Some(to) = to else { return };
        let end = self.end_and_zero_ns().0;
        self.span_ns = to;
        if let Some(cursor) = self.cursor_ns {
            // The cursor stays where it is on the screen.
            let after = end.saturating_sub(cursor);
            let after = u128::from(after) * u128::from(to) / u128::from(now);
            let end = cursor.saturating_add(u64::try_from(after).unwrap_or(u64::MAX));
            self.hold(end.min(self.newest_ns().unwrap_or(end)));
        }
    }

    /// Shows the cursor in the middle, where time stops, or hides it.
    pub(crate) fn toggle_cursor(&mut self) {
        if self.cursor_ns.take().is_none() {
            let end = self.end_and_zero_ns().0;
            self.hold(end);
            self.cursor_ns = Some(end.saturating_sub(self.span_ns / 2));
        }
    }

    /// Moves the cursor by parts of the time; what is seen follows it.
    pub(crate) fn move_cursor(&mut self, steps: i32, of: u16) {
        let Some(cursor) = self.cursor_ns else { return };
        let step = (self.span_ns / u64::from(of.max(1))).max(1);
        let by = step * u64::from(steps.unsigned_abs());
        let newest = self.newest_ns().unwrap_or(0);
        let to = if steps < 0 {
            cursor.saturating_sub(by)
        } else {
            cursor.saturating_add(by).min(newest)
        };
        self.cursor_ns = Some(to);
        let end = self.end_and_zero_ns().0;
        self.hold(end.clamp(to, to.saturating_add(self.span_ns)));
    }

    /// Fixes the range of the pane in focus at `seen`, or lets it follow the values again.
    pub(crate) fn fix_range(&mut self, seen: (f64, f64)) {
        if let Some(pane) = self.panes.get_mut(self.focus) {
            pane.range = match pane.range {
                Range::Auto => Range::Fixed(seen.0, seen.1),
                Range::Fixed(..) => Range::Auto,
            };
        }
    }

    /// Moves the range of the pane in focus up or down, and makes it so many times as large.
    pub(crate) fn move_range(&mut self, seen: (f64, f64), steps: i32, factor: f64) {
        if let Some(pane) = self.panes.get_mut(self.focus) {
            let (low, high) = match pane.range {
                Range::Auto => seen,
                Range::Fixed(low, high) => (low, high),
            };
            let (half, middle) = ((high - low) / 2.0, f64::midpoint(low, high));
            let middle = middle + f64::from(steps) * MOVE * 2.0 * half;
            let half = half * factor;
            let (low, high) = (middle - half, middle + half);
            if low.is_finite() && high.is_finite() && high - low > 1e-12 * middle.abs() {
                pane.range = Range::Fixed(low, high);
            }
        }
    }

    /// Goes to the next pane, or the one before.
    pub(crate) fn step_pane(&mut self, steps: isize) {
        let count = self.panes.len().max(1).cast_signed();
        self.focus = (self.focus.cast_signed() + steps)
            .rem_euclid(count)
            .cast_unsigned();
    }

    pub(crate) fn add_pane(&mut self, names: Vec<String>) {
        match self.panes.as_mut_slice() {
            // The first one, of which nothing has been said yet.
            [only] if only.names.is_empty() => only.names = names,
            _ => self.panes.push(Pane::new(names)),
        }
        self.focus = self.panes.len().saturating_sub(1);
    }

    pub(crate) fn remove_pane(&mut self) {
        if self.panes.len() > 1 {
            self.panes.remove(self.focus);
            self.focus = self.focus.min(self.panes.len() - 1);
        } else {
            self.panes = vec![Pane::new(Vec::new())];
        }
    }

    /// Shows the robot beside the plots, or alone.
    pub(crate) const fn show_robot(&mut self, is_alone: bool) {
        self.place = if is_alone {
            RobotPane::Alone
        } else {
            RobotPane::Beside
        };
    }

    /// Waits for a condition; `None` for none.
    pub(crate) fn arm(&mut self, condition: Option<Condition>) {
        self.trigger = condition.map(|condition| ArmedTrigger {
            trigger: Trigger::new(condition),
            curve: None,
            shown_ns: None,
            coming_ns: None,
        });
        self.held = None;
        self.find_names();
    }

    /// Returns the condition that is waited for, with the instant that is shown.
    pub(crate) fn trigger(&self) -> Option<(&Condition, Option<u64>)> {
        let armed = self.trigger.as_ref()?;
        Some((&armed.trigger.condition, armed.shown_ns))
    }

    /// Returns a few words on what is seen.
    pub(crate) fn state(&self) -> String {
        let mut text = span_text(self.span_ns);
        if self.is_held() {
            text += ", paused";
        }
        if let Some((condition, shown)) = self.trigger() {
            let curve = self.trigger.as_ref().and_then(|armed| armed.curve);
            let state = match (curve, shown) {
                (None, _) => "no such curve",
                (_, None) => "waits",
                (_, Some(_)) => "at 0",
            };
            // A string takes everything.
            let _ = write!(text, ", trigger {condition}: {state}");
        }
        text
    }

    /// Returns the history of a curve.
    pub(crate) fn history(&self, curve: usize) -> Option<&History> {
        self.curves.get(curve).map(|curve| &curve.history)
    }
}

impl ArmedTrigger {
    fn take(&mut self, sample: &Sample, span_ns: u64) {
        let fires = self.trigger.fires(sample.value);
        // Time may have gone back, with the run.
        let shown = self.shown_ns.filter(|shown| *shown <= sample.at_ns);
        self.shown_ns = shown;
        let is_free =
            shown.is_none_or(|shown| sample.at_ns >= shown.saturating_add(after(span_ns)));
        if fires && is_free && self.coming_ns.is_none() {
            self.coming_ns = Some(sample.at_ns);
        }
    }

    fn look(&mut self, newest_ns: u64, span_ns: u64) {
        let is_there = |at: &u64| newest_ns >= at.saturating_add(after(span_ns)) || newest_ns < *at;
        if let Some(at) = self.coming_ns.take_if(|at| is_there(at)) {
            self.shown_ns = Some(at);
        }
    }
}

/// The time that is seen after the instant of a trigger.
const fn after(span_ns: u64) -> u64 {
    span_ns - span_ns / BEFORE
}

fn moved(instant_ns: u64, span_ns: u64, steps: i32) -> u64 {
    let step = (MOVE * span_ns as f64) as u64;
    let by = step.max(1).saturating_mul(steps.unsigned_abs().into());
    if steps < 0 {
        instant_ns.saturating_sub(by)
    } else {
        instant_ns.saturating_add(by)
    }
}

/// Returns a length of time in the unit in which it is short.
pub(crate) fn span_text(ns: u64) -> String {
    let (unit, name) = match ns {
        1_000_000_000.. => (1e9, "s"),
        1_000_000.. => (1e6, "ms"),
        _ => (1e3, "µs"),
    };
    let value = ns as f64 / unit;
    format!("{} {name}", (value * 100.0).round() / 100.0)
}
