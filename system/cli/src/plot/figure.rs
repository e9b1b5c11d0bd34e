//! [`Figure`]: the robot as lines, seen from anywhere.

use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::symbols::Marker;
use ratatui::text::Line as Text;
use ratatui::widgets::Widget;
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Painter, Shape};

use super::curve::{Curve, Sample};
use super::scale::brief;
use condor_host::names::VariableName as _;
use condor_host::plain::plain;
use condor_host::robot::{Robot, RobotLine};

/// The angle by which a key turns the robot, rad.
const TURN: f64 = core::f64::consts::PI / 24.0;
/// The least difference of efforts between the weakest and the strongest colour, N.
const LEAST_N: f64 = 1.0;
/// Colours of efforts, from the least to the greatest.
const COLORS: [Color; 5] = [
    Color::Blue,
    Color::Cyan,
    Color::Green,
    Color::Yellow,
    Color::Red,
];

/// A robot, the curves that move it, and the direction from which it is seen.
pub(crate) struct Figure {
    robot: Box<dyn Robot>,
    /// The variables that are the efforts of tendons, by which these are coloured.
    tendons: Vec<String>,
    /// The curve of the position of each joint.
    positions: Vec<Option<usize>>,
    /// The curve of each effort.
    efforts: Vec<Option<usize>>,
    /// The least and the greatest effort that were seen, N.
    range: Option<[f64; 2]>,
    /// The points of the robot at zero and at its limits, m.
    extent: Vec<[f64; 3]>,
    /// The angle about the vertical axis, and the one above the horizon, rad.
    from: [f64; 2],
}

impl core::fmt::Debug for Figure {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Figure")
            .field("from", &self.from)
            .finish_non_exhaustive()
    }
}

impl Figure {
    pub(crate) fn new(robot: Box<dyn Robot>) -> Self {
        let low: Vec<f64> = robot.joints().iter().map(|it| it.limits[0]).collect();
        let high: Vec<f64> = robot.joints().iter().map(|it| it.limits[1]).collect();
        let postures = [&[], low.as_slice(), high.as_slice()];
        let lines = postures.into_iter().flat_map(|it| robot.lines(it));
        let extent = lines.flat_map(|line| line.points).collect();
        let lines = robot.lines(&[]).into_iter();
        let tendons: Vec<String> = lines.filter_map(|line| line.effort).collect();
        Self {
            positions: vec![None; robot.joints().len()],
            efforts: vec![None; tendons.len()],
            tendons,
            robot,
            range: None,
            extent,
            from: [-2.2, 0.5],
        }
    }

    /// Iterates over the variables that move the robot.
    pub(crate) fn variables(&self) -> impl Iterator<Item = &str> {
        let joints = self.robot.joints().iter();
        let positions = joints.map(|joint| joint.position.as_str());
        positions.chain(self.tendons.iter().map(String::as_str))
    }

    /// Looks for the variables among the curves.
    pub(crate) fn find(&mut self, curves: &[Curve]) {
        let place = |name: &str| curves.iter().position(|it| it.variable.is_called(name));
        let joints = self.robot.joints().iter();
        self.positions = joints.map(|joint| place(&joint.position)).collect();
        self.efforts = self.tendons.iter().map(|name| place(name)).collect();
    }

    pub(crate) fn take(&mut self, sample: &Sample) {
        if sample.value.is_finite() && self.efforts.contains(&Some(sample.curve)) {
            let [least, greatest] = self.range.unwrap_or([sample.value; 2]);
            self.range = Some([least.min(sample.value), greatest.max(sample.value)]);
        }
    }

    /// Turns the robot so many steps to the left, and up.
    pub(crate) fn turn(&mut self, left: i32, up: i32) {
        let [about, above] = &mut self.from;
        *about = (*about + TURN * f64::from(left)) % core::f64::consts::TAU;
        let quarter = core::f64::consts::FRAC_PI_2;
        *above = (*above + TURN * f64::from(up)).clamp(-quarter, quarter);
    }

    /// Returns where a point is on the screen: to the right, and up.
    fn seen(&self, [x, y, z]: [f64; 3]) -> (f64, f64) {
        let [about, above] = self.from.map(f64::sin_cos);
        let (right, away) = (y * about.1 - x * about.0, x * about.1 + y * about.0);
        (right, z * above.1 - away * above.0)
    }

    /// Returns the rectangle in which the robot is at zero and at its limits.
    fn frame(&self) -> [[f64; 2]; 2] {
        let mut frame = [[f64::MAX, f64::MIN]; 2];
        for point in &self.extent {
            let (right, up) = self.seen(*point);
            for ([least, greatest], value) in frame.iter_mut().zip([right, up]) {
                (*least, *greatest) = (least.min(value), greatest.max(value));
            }
        }
        frame
    }

    /// Draws the robot with the values that `value` returns for curves.
    pub(crate) fn draw(
        &self,
        value: impl Fn(usize) -> Option<f64>,
        has_colors: bool,
        area: Rect,
        buffer: &mut Buffer,
    ) {
        let rows = [Constraint::Fill(1), Constraint::Length(1)];
        let [picture, legend] = Layout::vertical(rows).areas(area);
        let of = |curve: &Option<usize>| curve.and_then(&value);
        let positions: Vec<f64> = self
            .positions
            .iter()
            .map(|it| of(it).unwrap_or(0.0))
            .collect();
        let lines = self.robot.lines(&positions);
        let (mut efforts, [least, greatest]) = (self.efforts.iter(), self.shown_range());
        let strokes = lines.iter().map(|line| {
            let is_tendon = line.effort.is_some();
            let effort = is_tendon.then(|| efforts.next()).flatten().and_then(of);
            let part = effort.map(|effort| ((effort - least) / (greatest - least)).clamp(0.0, 1.0));
            let points = line.points.iter().map(|point| self.seen(*point)).collect();
            DrawnLine { line, points, part }
        });
        let strokes: Vec<DrawnLine<'_>> = strokes.collect();
        let bounds = fitted(self.frame(), picture);
        Canvas::default()
            .marker(Marker::Braille)
            .x_bounds(bounds[0])
            .y_bounds(bounds[1])
            .paint(|context| {
                // Tendons are in front of bones, and strong ones in front of weak ones.
                for is_tendon in [false, true] {
                    let of_kind = |it: &&DrawnLine<'_>| it.line.effort.is_some() == is_tendon;
                    let mut of_kind: Vec<_> = strokes.iter().filter(of_kind).collect();
                    of_kind.sort_by(|a, b| a.part.unwrap_or(0.0).total_cmp(&b.part.unwrap_or(0.0)));
                    for drawn in of_kind {
                        context.draw(drawn);
                    }
                }
            })
            .render(picture, buffer);
        // Names are in front of digits.
        for drawn in strokes.iter().rev() {
            drawn.write(bounds, has_colors, picture, buffer);
        }
        let text = self.legend(has_colors);
        text.render(legend, buffer);
    }

    /// Returns the efforts of the weakest and of the strongest colour, N.
    fn shown_range(&self) -> [f64; 2] {
        let [least, greatest] = self.range.unwrap_or_default();
        [least, greatest.max(least + LEAST_N)]
    }

    fn legend(&self, has_colors: bool) -> Text<'static> {
        if self.positions.iter().all(Option::is_none) {
            return Text::raw(" no program shows its joints").dim();
        }
        if self.tendons.is_empty() {
            return Text::default();
        }
        let [least, greatest] = self.shown_range().map(brief);
        if !has_colors {
            return Text::raw(format!(" tendons: 0 is {least} N, 9 is {greatest} N")).dim();
        }
        let mut text = Text::raw(format!(" tendons {least} "));
        for color in COLORS {
            text.push_span("━━".fg(color));
        }
        text.push_span(format!(" {greatest} N"));
        text
    }
}

/// A line as it is seen.
struct DrawnLine<'l> {
    line: &'l RobotLine,
    points: Vec<(f64, f64)>,
    /// The place of the effort of a tendon in the range of all.
    part: Option<f64>,
}

impl DrawnLine<'_> {
    fn color(&self) -> Color {
        match (self.part, &self.line.effort) {
            (None, None) => Color::Reset,
            (None, Some(_)) => Color::DarkGray,
            (Some(part), _) => {
                let place = (part * COLORS.len() as f64) as usize;
                COLORS.get(place).copied().unwrap_or(Color::Red)
            }
        }
    }

    /// Writes the name of a part at its end, and without colours the digit of an effort.
    fn write(&self, bounds: [[f64; 2]; 2], has_colors: bool, area: Rect, buffer: &mut Buffer) {
        let [[left, right], [below, above]] = bounds;
        let at = |(x, y): (f64, f64)| {
            let column = (x - left) / (right - left) * f64::from(area.width);
            let row = (above - y) / (above - below) * f64::from(area.height);
            let is_inside = (0.0..f64::from(area.width)).contains(&column)
                && (0.0..f64::from(area.height)).contains(&row);
            is_inside.then_some((area.x + column as u16, area.y + row as u16))
        };
        let Some(end) = self.points.last().copied() else {
            return;
        };
        if self.line.effort.is_none() {
            if let Some((x, y)) = at(end) {
                let name = plain(&self.line.name);
                let room = usize::from(area.right().saturating_sub(x + 1));
                let style = Style::new().fg(Color::Reset).bold();
                buffer.set_stringn(x + 1, y, name, room, style);
            }
        } else if let (false, Some(part)) = (has_colors, self.part) {
            let middle = self
                .points
                .get(self.points.len() / 2)
                .copied()
                .unwrap_or(end);
            let before = self.points.get((self.points.len() / 2).saturating_sub(1));
            let before = before.copied().unwrap_or(middle);
            let middle = (
                f64::midpoint(middle.0, before.0),
                f64::midpoint(middle.1, before.1),
            );
            if let Some((x, y)) = at(middle) {
                let digit = char::from_digit((part * 9.99) as u32, 10).unwrap_or('9');
                let style = Style::new().fg(Color::Reset).bold();
                buffer.set_string(x, y, digit.to_string(), style);
            }
        }
    }
}

impl Shape for DrawnLine<'_> {
    fn draw(&self, painter: &mut Painter<'_, '_>) {
        for ((x1, y1), (x2, y2)) in self.points.iter().zip(self.points.iter().skip(1)) {
            Stroke::new(*x1, *y1, *x2, *y2, self.color()).draw(painter);
        }
    }
}

/// Returns a rectangle around `frame` that has the shape of an area, whose dots are squares.
fn fitted(frame: [[f64; 2]; 2], area: Rect) -> [[f64; 2]; 2] {
    let [dots_right, dots_up] = [2 * area.width.max(1), 4 * area.height.max(1)].map(f64::from);
    let sizes = frame.map(|[least, greatest]| (greatest - least).max(1e-3));
    // A little space is left for names.
    let dot = 1.1 * (sizes[0] / dots_right).max(sizes[1] / dots_up);
    let around = |[least, greatest]: [f64; 2], dots: f64| {
        let (middle, half) = (f64::midpoint(least, greatest), dot * dots / 2.0);
        [middle - half, middle + half]
    };
    [around(frame[0], dots_right), around(frame[1], dots_up)]
}
