//! [`Time`]: the axis of time, which all panes share.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

use super::AXIS;
use crate::plot::model::Plot;
use crate::plot::scale::Scale;

/// Columns of a mark of the axis of time.
const MARK: u16 = 12;

/// The time that is seen, in dots: a column has two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Time {
    pub(super) begin_ns: u64,
    pub(super) end_ns: u64,
    /// The instant that is 0 on the axis.
    zero_ns: u64,
    dot_ns: u64,
    columns: u16,
}

impl Time {
    /// Returns the time that is seen in so many columns. It begins and ends at whole dots, so that a curve
    /// moves by whole ones.
    pub(super) fn of(plot: &Plot, columns: u16) -> Self {
        let (end, zero) = plot.end_and_zero_ns();
        let dots = u64::from(columns.max(1)) * 2;
        let dot_ns = (plot.span_ns / dots).max(1);
        let aligned = end.div_ceil(dot_ns).saturating_mul(dot_ns);
        Self {
            begin_ns: aligned.saturating_sub(dots * dot_ns),
            end_ns: aligned,
            zero_ns: if zero == end { aligned } else { zero },
            dot_ns,
            columns,
        }
    }

    /// Returns the place of an instant, in dots from the left.
    pub(super) fn dot(self, instant_ns: u64) -> f64 {
        since(instant_ns, self.begin_ns) / self.dot_ns as f64
    }

    /// Returns the column of an instant, if it is seen.
    pub(super) fn column(self, instant_ns: u64) -> Option<u16> {
        let column = self.dot(instant_ns) / 2.0;
        let is_seen = (0.0..=f64::from(self.columns)).contains(&column);
        is_seen.then(|| (column as u16).min(self.columns.saturating_sub(1)))
    }

    /// Returns the instant in the middle of a column.
    pub(super) fn instant_ns(self, column: u16) -> u64 {
        let dots = 2 * u64::from(column) + 1;
        self.begin_ns.saturating_add(dots * self.dot_ns)
    }

    /// Returns the number of dots.
    pub(super) fn dots(self) -> usize {
        2 * usize::from(self.columns)
    }

    /// Draws the axis, and before it the instant of the cursor.
    pub(super) fn draw_axis(self, plot: &Plot, area: Rect, buffer: &mut Buffer) {
        let span = self.end_ns.saturating_sub(self.begin_ns);
        let ends = [self.begin_ns, self.end_ns];
        let times = ends.map(|it| it.abs_diff(self.zero_ns));
        let (unit_ns, unit) = match times.into_iter().fold(span, u64::max) {
            900_000_000.. => (1e9, "s"),
            900_000.. => (1e6, "ms"),
            _ => (1e3, "µs"),
        };
        let at = |instant| since(instant, self.zero_ns) / unit_ns;
        let (begin, end) = (
            at(self.end_ns) - since(self.end_ns, self.begin_ns) / unit_ns,
            at(self.end_ns),
        );
        if let Some(cursor) = plot.cursor_ns {
            // To the nanosecond: the marks are at whole dots.
            let (_, zero) = plot.end_and_zero_ns();
            let time = since(cursor, zero) / unit_ns;
            let width = usize::from(AXIS.min(area.width));
            let texts = (0..4)
                .rev()
                .map(|digits| format!("│{time:.digits$} {unit}"));
            let fitting = texts.into_iter().find(|it| it.chars().count() <= width);
            let text = fitting.unwrap_or_default();
            buffer.set_stringn(area.x, area.y, text, width, Style::new());
        }
        let scale = Scale::of(begin, end, self.columns / MARK);
        let is_zero = |value: f64| value.abs() < scale.step / 2.0;
        let marks: Vec<_> = scale.marks().collect();
        // The unit is at 0, or at the last one.
        let zero = marks.iter().position(|(value, _)| is_zero(*value));
        let with_unit = zero.unwrap_or(marks.len().saturating_sub(1));
        for (place, (value, text)) in marks.into_iter().enumerate() {
            let text = if is_zero(value) { "0".into() } else { text };
            let text = if place == with_unit {
                format!("{text} {unit}")
            } else {
                text
            };
            let width = text.chars().count() as u16;
            let column = scale.part(value) * f64::from(self.columns);
            let column = (AXIS + column as u16).saturating_sub(width / 2);
            // The last one ends with the axis.
            let column = column.min((AXIS + self.columns).saturating_sub(width));
            if plot.cursor_ns.is_some() && column < AXIS {
                continue;
            }
            let room = area.width.saturating_sub(column);
            let style = Style::new();
            buffer.set_stringn(area.x + column, area.y, text, room.into(), style);
        }
    }
}

/// Returns the nanoseconds from one instant to another: below 0 if that was before.
fn since(instant_ns: u64, other_ns: u64) -> f64 {
    if instant_ns >= other_ns {
        (instant_ns - other_ns) as f64
    } else {
        -((other_ns - instant_ns) as f64)
    }
}
