//! Small multiples of curves over time, as SVG.

use std::fmt::Write as _;
use std::path::Path;

use condor_hand::math::{abs, max, min};

use super::rig::Result;

/// Degrees, at each tick.
pub(crate) type Curve = Vec<f64>;

/// One joint: where it was to be, and where it was.
pub(crate) struct Panel {
    name: String,
    period_s: f64,
    target: Curve,
    actual: Curve,
}

/// The plot area of a panel and the room around it, px.
const WIDTH: f64 = 250.0;
const HEIGHT: f64 = 130.0;
const GAP: f64 = 26.0;
const LEFT: f64 = 92.0;
const TOP: f64 = 104.0;
const BOTTOM: f64 = 58.0;
const RIGHT: f64 = 24.0;

/// Ticks of the servos between two points of a curve: more than a pixel has are of no use.
const STRIDE: usize = 4;

const STYLE: &str = "
  text { font: 12px system-ui, 'DejaVu Sans', sans-serif; fill: #333; }
  .title { font-size: 18px; font-weight: 600; fill: #111; }
  .head { font-size: 14px; font-weight: 600; text-anchor: middle; }
  .x { text-anchor: middle; }
  .y { text-anchor: end; }
  .error { font-size: 11px; fill: #666; text-anchor: end; }
  .frame { fill: #fff; stroke: #bbb; }
  .grid { stroke: #e6e6e6; }
  .target { fill: none; stroke: #f0a04b; stroke-width: 4.5; stroke-linejoin: round; stroke-linecap: round; }
  .actual { fill: none; stroke: #1f4e79; stroke-width: 1.4; stroke-linejoin: round; }
";

impl Panel {
    pub(crate) fn new(name: String, period_s: f64, target: &Curve, actual: &Curve) -> Self {
        Self {
            name,
            period_s,
            target: target.clone(),
            actual: actual.clone(),
        }
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Degrees, at each tick.
    pub(crate) fn errors(&self) -> Curve {
        let both = self.target.iter().zip(&self.actual);
        both.map(|(target, actual)| target - actual).collect()
    }

    fn duration_s(&self) -> f64 {
        self.period_s * number(self.target.len())
    }

    /// The part of the name before or after the dot.
    fn part(&self, index: usize) -> &str {
        self.name.split('.').nth(index).unwrap_or(&self.name)
    }
}

fn number(count: usize) -> f64 {
    f64::from(u32::try_from(count).unwrap_or(u32::MAX))
}

/// A scale of values on a length of pixels.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
    pixels: f64,
}

impl Axis {
    /// From a round number to a round number, with a handful of steps.
    fn around(low: f64, high: f64, pixels: f64) -> Self {
        let span = max(high - low, 1e-6);
        let steps = [
            0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 90.0, 180.0,
        ];
        let step = steps
            .into_iter()
            .find(|step| span / step <= 5.0)
            .unwrap_or(360.0);
        Self {
            low: (low / step).floor() * step,
            high: (high / step).ceil() * step,
            step,
            pixels,
        }
    }

    /// The same range of values for one that has nothing to show.
    fn exactly(low: f64, high: f64, pixels: f64) -> Self {
        let step = Self::around(low, high, pixels).step;
        Self {
            low,
            high,
            step,
            pixels,
        }
    }

    fn at(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low) * self.pixels
    }

    fn marks(&self) -> impl Iterator<Item = f64> + '_ {
        let first = (self.low / self.step).ceil();
        let marks = (0..100).map(move |n| (first + f64::from(n)) * self.step);
        marks.take_while(|mark| *mark <= self.high + 1e-9)
    }
}

/// Draws panels, column by column, `rows` in each.
pub(crate) fn write(path: &Path, title: &str, rows: usize, panels: &[Panel]) -> Result<()> {
    if let Some(parent) = path.parent() {
        std::fs::create_dir_all(parent)?;
    }
    let text = draw(title, rows, panels)?;
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()).into())
}

fn draw(title: &str, rows: usize, panels: &[Panel]) -> Result<String> {
    let columns = panels.len().div_ceil(rows);
    let width = LEFT + number(columns) * (WIDTH + GAP) - GAP + RIGHT;
    let height = TOP + number(rows) * (HEIGHT + GAP) - GAP + BOTTOM;
    let mut svg = String::new();
    writeln!(
        svg,
        r##"<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">
<style>{STYLE}</style>
<rect width="100%" height="100%" fill="#fafafa"/>
<text class="title" x="{LEFT}" y="34">{}: joint angles over time</text>"##,
        escaped(title)
    )?;
    legend(&mut svg, width)?;
    let duration = panels.iter().map(Panel::duration_s).fold(0.0, max);
    let time = Axis::exactly(0.0, duration, WIDTH);
    for row in 0..rows {
        let of_row = || panels.iter().skip(row).step_by(rows);
        let angle = scale(of_row());
        let y = TOP + number(row) * (HEIGHT + GAP);
        for (column, panel) in of_row().enumerate() {
            let x = LEFT + number(column) * (WIDTH + GAP);
            writeln!(svg, r#"<g transform="translate({x} {y})">"#)?;
            if row == 0 {
                let name = escaped(panel.part(0));
                writeln!(
                    svg,
                    r#"<text class="head" x="{}" y="-24">{name}</text>"#,
                    WIDTH / 2.0
                )?;
            }
            if column == 0 {
                angles(&mut svg, &angle, panel.part(1))?;
            }
            if row + 1 == rows {
                times(&mut svg, &time)?;
            }
            curves(&mut svg, panel, &time, &angle)?;
            svg += "</g>\n";
        }
    }
    svg += "</svg>\n";
    Ok(svg)
}

/// The range of all curves of some panels, degrees.
fn scale<'a>(panels: impl Iterator<Item = &'a Panel>) -> Axis {
    let curves = panels.flat_map(|panel| panel.target.iter().chain(&panel.actual));
    let (low, high) = curves.fold((f64::MAX, f64::MIN), |(low, high), &value| {
        (min(low, value), max(high, value))
    });
    // Room for the text and the width of the lines.
    let room = 0.06 * (high - low) + 0.5;
    Axis::around(low - room, high + room, HEIGHT)
}

fn legend(svg: &mut String, width: f64) -> Result<()> {
    let at = width - RIGHT - 230.0;
    writeln!(
        svg,
        r#"<g transform="translate({at} 30)">
<line class="target" x1="0" y1="0" x2="34" y2="0"/><text x="44" y="4">target</text>
<line class="actual" x1="118" y1="0" x2="152" y2="0"/><text x="162" y="4">actual</text>
</g>"#
    )?;
    Ok(())
}

/// The vertical axis of a row of panels.
fn angles(svg: &mut String, angle: &Axis, joint: &str) -> Result<()> {
    for mark in angle.marks() {
        let y = HEIGHT - angle.at(mark) + 4.0;
        writeln!(svg, r#"<text class="y" x="-8" y="{y:.1}">{mark}°</text>"#)?;
    }
    let middle = HEIGHT / 2.0;
    writeln!(
        svg,
        r#"<text class="head" transform="translate(-62 {middle}) rotate(-90)">{}</text>"#,
        escaped(joint)
    )?;
    Ok(())
}

/// The horizontal axis of a column of panels.
fn times(svg: &mut String, time: &Axis) -> Result<()> {
    for mark in time.marks() {
        let x = time.at(mark);
        writeln!(
            svg,
            r#"<text class="x" x="{x:.1}" y="{}">{mark}</text>"#,
            HEIGHT + 18.0
        )?;
    }
    writeln!(
        svg,
        r#"<text class="x" x="{}" y="{}">time, s</text>"#,
        WIDTH / 2.0,
        HEIGHT + 38.0
    )?;
    Ok(())
}

fn curves(svg: &mut String, panel: &Panel, time: &Axis, angle: &Axis) -> Result<()> {
    writeln!(
        svg,
        r#"<rect class="frame" width="{WIDTH}" height="{HEIGHT}"/>"#
    )?;
    for mark in angle.marks() {
        let y = HEIGHT - angle.at(mark);
        writeln!(
            svg,
            r#"<line class="grid" x1="0" x2="{WIDTH}" y1="{y:.1}" y2="{y:.1}"/>"#
        )?;
    }
    for mark in time.marks() {
        let x = time.at(mark);
        writeln!(
            svg,
            r#"<line class="grid" x1="{x:.1}" x2="{x:.1}" y1="0" y2="{HEIGHT}"/>"#
        )?;
    }
    for (class, curve) in [("target", &panel.target), ("actual", &panel.actual)] {
        write!(svg, r#"<polyline class="{class}" points=""#)?;
        for (tick, &value) in curve.iter().enumerate().step_by(STRIDE) {
            let x = time.at(panel.period_s * number(tick));
            let y = HEIGHT - angle.at(value);
            write!(svg, "{x:.1},{y:.1} ")?;
        }
        writeln!(svg, r#""/>"#)?;
    }
    let peak = panel.errors().into_iter().map(abs).fold(0.0, max);
    writeln!(
        svg,
        r#"<text class="error" x="{WIDTH}" y="-5">peak error {peak:.2}°</text>"#
    )?;
    Ok(())
}

/// Text that is no markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}
