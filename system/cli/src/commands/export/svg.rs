//! Curves as SVG: one panel for each unit, light or dark as the viewer is.

use std::fmt::Write as _;
use std::ops::Range;

use super::curve::Curve;
use crate::plot::scale::Scale;

/// Sizes in pixels.
const WIDTH: f64 = 960.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 24.0;
const HEAD: f64 = 44.0;
const PANEL: f64 = 200.0;
/// The distance between two panels, without lines of names.
const GAP: f64 = 40.0;
const NAMES: f64 = 18.0;
const NAMES_IN_LINE: usize = 3;
/// The number of colours.
const COLOURS: usize = 8;
/// The number of marks on an axis, about.
const MARKS: u16 = 6;

const STYLE: &str = "\
text{font:12px sans-serif;fill:#333}.title{font-size:15px}
.back{fill:#fff}.grid{stroke:#ddd}.frame{fill:none;stroke:#888}
.curve{fill:none;stroke-width:1.5;stroke-linejoin:round}.dot{stroke-width:3;stroke-linecap:round}
.c0{stroke:#0072b2}.c1{stroke:#d55e00}.c2{stroke:#009e73}.c3{stroke:#cc79a7}
.c4{stroke:#b8860b}.c5{stroke:#3a3a9f}.c6{stroke:#7f7f7f}.c7{stroke:#a02020}
@media(prefers-color-scheme:dark){text{fill:#ccc}.back{fill:#1b1b1b}.grid{stroke:#3a3a3a}
.c0{stroke:#56b4e9}.c1{stroke:#f0883e}.c2{stroke:#3fd6a5}.c3{stroke:#e7a6c9}
.c4{stroke:#f0e442}.c5{stroke:#9d9dff}.c6{stroke:#b0b0b0}.c7{stroke:#ff7b7b}}
";

/// Draws curves over the time `shown`, in seconds.
pub(super) fn draw(title: &str, shown: Range<f64>, curves: &[Curve]) -> String {
    let mut panels: Vec<(&str, Vec<&Curve>)> = Vec::new();
    for curve in curves {
        match panels.iter_mut().find(|(unit, _)| *unit == curve.unit) {
            Some((_, others)) => others.push(curve),
            None => panels.push((&curve.unit, vec![curve])),
        }
    }
    let mut text = String::new();
    let mut top = HEAD;
    for (unit, curves) in &panels {
        top += NAMES * float(curves.len().div_ceil(NAMES_IN_LINE));
        panel(&mut text, top, unit, &shown, curves);
        top += PANEL + GAP;
    }
    let (height, title) = (top + 4.0, escaped(title));
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" \
         viewBox=\"0 0 {WIDTH} {height}\">\n<style>{STYLE}</style>\n\
         <rect class=\"back\" width=\"100%\" height=\"100%\"/>\n\
         <text class=\"title\" x=\"{LEFT}\" y=\"26\">{title}</text>\n{text}</svg>\n"
    )
}

/// An axis: what it shows, and where.
struct Axis {
    scale: Scale,
    pixels: Range<f64>,
}

impl Axis {
    fn at(&self, value: f64) -> f64 {
        self.pixels.start + self.scale.part(value) * (self.pixels.end - self.pixels.start)
    }
}

fn panel(text: &mut String, top: f64, unit: &str, shown: &Range<f64>, curves: &[&Curve]) {
    for (number, curve) in curves.iter().enumerate() {
        let column = float(number % NAMES_IN_LINE);
        let line = curves.len().div_ceil(NAMES_IN_LINE) - number / NAMES_IN_LINE;
        let x = LEFT + column * (WIDTH - LEFT - RIGHT) / float(NAMES_IN_LINE);
        let y = top - NAMES * float(line) + 6.0;
        let (colour, name) = (number % COLOURS, escaped(&curve.name));
        add(
            text,
            format_args!(
                "<path class=\"dot c{colour}\" d=\"M{x:.0} {y:.0}h16\"/>\
                 <text x=\"{:.0}\" y=\"{:.0}\">{name}</text>\n",
                x + 22.0,
                y + 4.0
            ),
        );
    }
    let ranges = curves.iter().filter_map(|curve| curve.range());
    let values = ranges.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
    let bottom = top + PANEL;
    let times = if shown.start < shown.end {
        Scale::of
    } else {
        Scale::around
    };
    let across = Axis {
        scale: times(shown.start, shown.end, MARKS),
        pixels: LEFT..WIDTH - RIGHT,
    };
    let values = values.unwrap_or(0.0..1.0);
    let up = Axis {
        scale: Scale::around(values.start, values.end, MARKS),
        pixels: bottom..top,
    };
    let (width, middle) = (WIDTH - RIGHT - LEFT, top + PANEL / 2.0);
    for (mark, label) in across.scale.marks() {
        let (x, y) = (across.at(mark), bottom + 16.0);
        add(
            text,
            format_args!(
                "<path class=\"grid\" d=\"M{x:.1} {top}V{bottom}\"/>\
                 <text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{label}</text>\n"
            ),
        );
    }
    for (mark, label) in up.scale.marks() {
        let (x, y) = (LEFT - 6.0, up.at(mark));
        add(
            text,
            format_args!(
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}h{width}\"/>\
                 <text x=\"{x}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>\n",
                y + 4.0
            ),
        );
    }
    let unit = if unit.is_empty() { "value" } else { unit };
    add(
        text,
        format_args!(
            "<rect class=\"frame\" x=\"{LEFT}\" y=\"{top}\" width=\"{width}\" height=\"{PANEL}\"/>\n\
             <text transform=\"translate(16 {middle}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n\
             <text x=\"{}\" y=\"{}\" text-anchor=\"end\">time [s]</text>\n",
            escaped(unit),
            WIDTH - RIGHT,
            bottom + 32.0
        ),
    );
    for (number, curve) in curves.iter().enumerate() {
        let colour = number % COLOURS;
        for piece in curve.pieces() {
            let points = piece
                .iter()
                .map(|(at, value)| format!("{:.1},{:.1}", across.at(*at), up.at(*value)));
            let points: Vec<_> = points.collect();
            // A single point would not be seen.
            let class = if points.len() == 1 { "dot" } else { "curve" };
            let last = points.last().cloned().unwrap_or_default();
            let points = points.join(" ");
            add(
                text,
                format_args!(
                    "<polyline class=\"{class} c{colour}\" points=\"{points} {last}\"/>\n"
                ),
            );
        }
    }
}

fn add(text: &mut String, more: core::fmt::Arguments<'_>) {
    // A string takes everything.
    let _ = text.write_fmt(more);
}

fn float(count: usize) -> f64 {
    f64::from(count as u32)
}

fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    // XML has no other control characters, not even as references.
    text.replace(|it: char| it.is_control(), " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_a_panel_for_each_unit() {
        let curve = |name, unit| {
            let mut curve = Curve::new(name, unit, 0.0..2.0);
            for number in 0..=20_u32 {
                curve.add(f64::from(number) / 10.0, f64::from(number % 7));
            }
            curve
        };
        let curves = [curve("a<b", "rad"), curve("c", "N"), curve("d", "rad")];
        let text = draw("run & more", 0.0..2.0, &curves);
        assert_eq!(text.matches("<rect class=\"frame\"").count(), 2);
        assert_eq!(text.matches("<polyline class=\"curve").count(), 3);
        assert!(text.contains(">a&lt;b<") && text.contains(">run &amp; more<"));
        assert!(text.contains(">rad</text>") && text.contains("time [s]"));
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    }

    #[test]
    fn what_cannot_be_scaled_is_shown_all_the_same() {
        for value in [0.0, -1e300, 1e-320, 5.0] {
            let mut curve = Curve::new("a", "", 3.0..3.0);
            curve.add(3.0, value);
            let text = draw("", 3.0..3.0, &[curve, Curve::new("b", "", 3.0..3.0)]);
            assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
            assert_eq!(text.matches("<polyline class=\"dot").count(), 1);
        }
        assert!(draw("", 0.0..0.0, &[]).ends_with("</svg>\n"));
    }
}
