//! One pane: its legend, its axis of values, and its curves.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span as Text};
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Painter, Shape};

use super::AXIS;
use super::time::Time;
use crate::plot::curve::{Curve, Pane, Range};
use crate::plot::history::{History, Span};
use crate::plot::model::Plot;
use crate::plot::scale::{Scale, brief};
use condor_host::names::VariableName as _;
use condor_host::plain::plain;

/// Colours of the curves of a pane; letters distinguish them without.
const COLORS: [Color; 6] = [
    Color::Cyan,
    Color::Yellow,
    Color::Green,
    Color::Magenta,
    Color::Red,
    Color::Blue,
];
const LETTERS: &[u8; 52] = b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";
/// Columns from one letter on a curve to the next.
const APART: usize = 24;
/// Rows of a mark of the axis of values.
const MARK: u16 = 3;
/// The dots that are looked at for the range of values that is seen.
const DOTS: usize = 400;

/// Returns the least and the greatest value of a pane in the time that is seen; 0 to 1 without any.
pub(crate) fn seen(plot: &Plot, pane: &Pane) -> (f64, f64) {
    let end = plot.end_and_zero_ns().0;
    let begin = end.saturating_sub(plot.span_ns);
    let histories = pane.curves.iter().filter_map(|curve| plot.history(*curve));
    let spans = histories.flat_map(|history| history.spans(begin, end, DOTS));
    let spans = spans.filter(|span| !span.is_gap() && span.to_ns >= begin && span.from_ns <= end);
    let range = spans.fold(None, |range: Option<(f64, f64)>, span| {
        let (low, high) = range.unwrap_or((span.low, span.high));
        Some((low.min(span.low), high.max(span.high)))
    });
    range.unwrap_or((0.0, 1.0))
}

pub(super) fn draw(plot: &Plot, number: usize, time: Time, area: Rect, buffer: &mut Buffer) {
    let Some(pane) = plot.panes.get(number) else {
        return;
    };
    let is_focus = number == plot.focus && plot.panes.len() > 1;
    let legend = legend(plot, pane, is_focus, area.width, area.height / 3);
    let height = (legend.len() as u16).min(area.height);
    for (row, line) in legend.into_iter().enumerate() {
        let row = Rect::new(area.x, area.y + row as u16, area.width, 1);
        line.render(row.intersection(area), buffer);
    }
    let graph = Rect {
        x: area.x + AXIS.min(area.width),
        y: area.y + height,
        width: area.width.saturating_sub(AXIS),
        height: area.height - height,
    };
    if graph.is_empty() {
        return;
    }
    let marks = graph.height / MARK + 1;
    let scale = match pane.range {
        Range::Auto => {
            let (low, high) = seen(plot, pane);
            Scale::around(low, high, marks)
        }
        Range::Fixed(low, high) => Scale::of(low, high, marks),
    };
    let graph = Graph {
        area: graph,
        time,
        scale,
    };
    graph.axis(matches!(pane.range, Range::Fixed(..)), buffer);
    graph.curves(plot, pane, buffer);
    graph.letters(plot, pane, buffer);
    graph.lines(plot, pane, buffer);
}

/// The curves' letters, names and values, as many as there are rows for.
fn legend<'p>(plot: &'p Plot, pane: &Pane, is_focus: bool, width: u16, rows: u16) -> Vec<Line<'p>> {
    let mark = if is_focus { "▶" } else { " " };
    let mut lines = vec![Line::from(Text::raw(mark).bold())];
    if pane.curves.is_empty() {
        let text = match pane.names.as_slice() {
            [] => "no variables: n chooses some",
            _ => "…",
        };
        for line in &mut lines {
            line.push_span(Text::raw(text).dim());
        }
        return lines;
    }
    let (at, rows) = (plot.told_ns(), usize::from(rows.max(1)));
    for (place, number) in pane.curves.iter().enumerate() {
        let Some(curve) = plot.curves.get(*number) else {
            continue;
        };
        let text = format!(
            "{} {} {}",
            letter(*number),
            name(plot, curve),
            value(curve, at)
        );
        let item = Text::styled(format!("{}  ", plain(&text)), style(place));
        let row = lines.len();
        let Some(line) = lines.last_mut() else { break };
        if line.width() <= 1 || line.width() + item.width() <= usize::from(width) + 2 {
            line.push_span(item);
        } else if row < rows {
            lines.push(Line::from(vec![Text::raw(" "), item]));
        } else {
            let left = format!("+{}", pane.curves.len() - place);
            let kept = usize::from(width).saturating_sub(left.len() + 1);
            while line.width() > kept && line.spans.len() > 2 {
                line.spans.pop();
            }
            line.push_span(Text::raw(left).dim());
            break;
        }
    }
    lines
}

/// The name of a curve, with its processor and loop if another one has the same name.
fn name(plot: &Plot, curve: &Curve) -> String {
    let name = &curve.variable.name;
    let mut same = plot.curves.iter().filter(|it| it.variable.name == *name);
    if same.nth(1).is_some() {
        let [.., in_loop] = curve.variable.names();
        in_loop
    } else {
        name.clone()
    }
}

fn value(curve: &Curve, at_ns: u64) -> String {
    let unit = &curve.variable.unit;
    match curve.history.at(at_ns) {
        None => "-".into(),
        Some((low, high)) if low.to_bits() == high.to_bits() => {
            let place = (low >= 0.0 && low.fract() == 0.0).then_some(low as usize);
            if let Some(label) = place.and_then(|place| curve.variable.labels.get(place)) {
                return label.clone();
            }
            format!("{:>6} {unit}", brief(low)).trim_end().to_owned()
        }
        Some((low, high)) => format!("{}…{} {unit}", brief(low), brief(high))
            .trim_end()
            .to_owned(),
    }
}

fn style(place: usize) -> Style {
    let color = COLORS.get(place % COLORS.len());
    Style::new().fg(color.copied().unwrap_or(Color::Reset))
}

fn letter(curve: usize) -> char {
    LETTERS
        .get(curve % LETTERS.len())
        .copied()
        .map_or('?', char::from)
}

/// The area in which curves are drawn, and its axes.
#[derive(Clone, Copy)]
struct Graph {
    area: Rect,
    time: Time,
    scale: Scale,
}

impl Graph {
    /// Returns the row of a value, if it is seen.
    fn row(&self, value: f64) -> Option<u16> {
        let part = self.scale.part(value);
        let row = (1.0 - part) * f64::from(self.area.height - 1);
        (0.0..=1.0)
            .contains(&part)
            .then(|| self.area.y + row.round() as u16)
    }

    fn axis(&self, is_fixed: bool, buffer: &mut Buffer) {
        let Rect { x, y, height, .. } = self.area;
        let line = if is_fixed { "┃" } else { "│" };
        for row in y..y + height {
            buffer.set_string(x - 1, row, line, Style::new().dim());
        }
        for (value, text) in self.scale.marks() {
            if let Some(row) = self.row(value) {
                let width = usize::from(AXIS - 2);
                let text = format!("{text:>width$.width$} ");
                buffer.set_string(x - AXIS, row, text, Style::new());
                buffer.set_string(x - 1, row, "┤", Style::new());
            }
        }
    }

    fn curves(&self, plot: &Plot, pane: &Pane, buffer: &mut Buffer) {
        let Rect { width, height, .. } = self.area;
        let [right, top] = [2 * width - 1, 4 * height - 1].map(f64::from);
        Canvas::default()
            .marker(Marker::Braille)
            .x_bounds([0.0, right])
            .y_bounds([0.0, top])
            .paint(|context| {
                for (place, curve) in pane.curves.iter().enumerate().rev() {
                    if let Some(curve) = plot.curves.get(*curve) {
                        let color = style(place).fg.unwrap_or_default();
                        context.draw(&Trace {
                            graph: self,
                            curve,
                            top,
                            color,
                        });
                    }
                }
            })
            .render(self.area, buffer);
    }

    /// Writes the letters of several curves onto them, here and there.
    fn letters(&self, plot: &Plot, pane: &Pane, buffer: &mut Buffer) {
        let count = pane.curves.len();
        if count < 2 {
            return;
        }
        for (place, number) in pane.curves.iter().enumerate() {
            let first = APART / 4 + place * APART / count;
            for column in (first..usize::from(self.area.width)).step_by(APART.max(count)) {
                let column = column as u16;
                let at = plot
                    .history(*number)
                    .and_then(|history| history.at(self.time.instant_ns(column)));
                let newest = plot.history(*number).and_then(History::newest_ns);
                let is_past = newest.is_some_and(|newest| self.time.instant_ns(column) <= newest);
                let row = at.and_then(|(low, high)| self.row(f64::midpoint(low, high)));
                if let (Some(row), true) = (row, is_past) {
                    let text = letter(*number).to_string();
                    buffer.set_string(self.area.x + column, row, text, style(place).bold());
                }
            }
        }
    }

    /// Draws the cursor, and the instant and the level of the trigger, behind the curves.
    fn lines(&self, plot: &Plot, pane: &Pane, buffer: &mut Buffer) {
        let Rect {
            x,
            y,
            width,
            height,
        } = self.area;
        let mut put = |column: u16, row: u16, text: &str| {
            if let Some(cell) = buffer.cell_mut((column, row))
                && matches!(cell.symbol(), " " | "⠀")
            {
                cell.set_symbol(text);
                cell.set_style(Style::new().dim());
            }
        };
        if let Some((condition, shown)) = plot.trigger() {
            let mut curves = pane
                .curves
                .iter()
                .filter_map(|curve| plot.curves.get(*curve));
            let is_here = curves.any(|curve| curve.variable.is_called(&condition.name));
            if let (true, Some(row)) = (is_here, self.row(condition.level)) {
                (x..x + width).for_each(|column| put(column, row, "╌"));
            }
            if let Some(column) = shown.and_then(|shown| self.time.column(shown)) {
                (y..y + height).for_each(|row| put(x + column, row, "╎"));
            }
        }
        if let Some(column) = plot.cursor_ns.and_then(|cursor| self.time.column(cursor)) {
            (y..y + height).for_each(|row| put(x + column, row, "│"));
        }
    }
}

/// A curve, as lines from span to span.
struct Trace<'g> {
    graph: &'g Graph,
    curve: &'g Curve,
    /// The highest dot.
    top: f64,
    color: Color,
}

impl Trace<'_> {
    /// Returns the dots of a span: from left to right, and from below to above.
    fn dots(&self, span: &Span) -> [f64; 4] {
        let height = |value| {
            // Values that are far outside are drawn as far away as lines can be.
            (self.graph.scale.part(value) * self.top).clamp(-1e4, 1e4)
        };
        let time = self.graph.time;
        let last = time.dots() as f64;
        let [from, to] = [span.from_ns, span.to_ns].map(|at| time.dot(at).clamp(-1e4, last + 1e4));
        [from, to, height(span.low), height(span.high)]
    }
}

impl Shape for Trace<'_> {
    fn draw(&self, painter: &mut Painter<'_, '_>) {
        let time = self.graph.time;
        let mut line = |x1, y1, x2, y2| {
            Stroke::new(x1, y1, x2, y2, self.color).draw(painter);
        };
        let mut before: Option<[f64; 3]> = None;
        let history = &self.curve.history;
        for span in history.spans(time.begin_ns, time.end_ns, 2 * time.dots()) {
            if span.is_gap() {
                before = None;
                continue;
            }
            let [from, to, low, high] = self.dots(&span);
            if let Some([at, before_low, before_high]) = before {
                let (begin, end) = if low > before_high {
                    (before_high, low)
                } else if high < before_low {
                    (before_low, high)
                } else {
                    let both = low.max(before_low);
                    (both, both)
                };
                line(at, begin, from, end);
            }
            // A span of an old time may be several dots wide.
            let wide = (to.min(time.dots() as f64) - from.max(0.0)).max(0.0) as u32;
            for dot in 0..=wide {
                let x = from.max(0.0) + f64::from(dot);
                if to >= 0.0 {
                    line(x, low, x, high);
                }
            }
            before = Some([to, low, high]);
        }
    }
}
