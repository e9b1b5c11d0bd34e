//! A terminal's screen as SVG. Dots of braille are drawn, since fonts have them in various widths.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::num::NonZero;

/// The size of a cell.
const CELL: (u16, u16) = (8, 16);
/// The border around all.
const BORDER: u16 = 8;
const BACKGROUND: &str = "#14161b";
const FOREGROUND: &str = "#d4d6da";
const DIM: &str = "#8b8f98";
/// The colours that have numbers: first the dark ones, then the bright ones.
const COLORS: [&str; 16] = [
    "#14161b", "#e5534b", "#57ab5a", "#c69026", "#539bf5", "#b083f0", "#39c5cf", "#d4d6da",
    "#768390", "#ff938a", "#6bc46d", "#daaa3f", "#6cb6ff", "#dcbdfb", "#56d4dd", "#ffffff",
];

/// Returns the picture of a screen whose lines have the escape sequences of a terminal.
pub(super) fn of(lines: &str, columns: u16, rows: u16) -> String {
    let at_least_one = |count| NonZero::new(count).unwrap_or(NonZero::<u16>::MIN);
    let mut parser = vt100::Parser::new(at_least_one(rows), at_least_one(columns), 0);
    parser.process(
        lines
            .trim_end_matches('\n')
            .replace('\n', "\r\n")
            .as_bytes(),
    );
    let screen = parser.screen();
    let (width, height) = (columns * CELL.0 + 2 * BORDER, rows * CELL.1 + 2 * BORDER);
    // A string takes everything.
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"ui-monospace,'DejaVu Sans Mono',Menlo,Consolas,monospace\" font-size=\"13.29\" \
         xml:space=\"preserve\"><rect width=\"{width}\" height=\"{height}\" rx=\"6\" \
         fill=\"{BACKGROUND}\"/>\n"
    );
    let mut dots = BTreeMap::<String, String>::new();
    for row in 0..rows {
        let mut run: Option<Run> = None;
        for column in 0..columns {
            let cell = screen.cell(row, column);
            let look = cell.map_or_else(Look::default, Look::of);
            let text = cell.map_or(" ", |cell| {
                if cell.has_contents() {
                    cell.contents()
                } else {
                    " "
                }
            });
            if let Some(pattern) = braille(text) {
                let path = dots.entry(look.front.clone()).or_default();
                put_dots(path, pattern, column, row);
            }
            let text = braille(text).map_or(text, |_| " ");
            match &mut run {
                Some(run) if run.look == look => run.text += text,
                _ => {
                    if let Some(run) = run.take() {
                        run.write(row, &mut svg);
                    }
                    run = Some(Run {
                        look,
                        column,
                        text: text.into(),
                    });
                }
            }
        }
        if let Some(run) = run {
            run.write(row, &mut svg);
        }
    }
    for (color, path) in dots {
        let _ = writeln!(
            svg,
            "<path d=\"{path}\" stroke=\"{color}\" stroke-width=\"2.6\" stroke-linecap=\"round\"/>"
        );
    }
    svg + "</svg>\n"
}

/// The colours and the weight of a cell.
#[derive(Clone, Debug, PartialEq)]
struct Look {
    front: String,
    back: Option<String>,
    is_bold: bool,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            front: FOREGROUND.into(),
            back: None,
            is_bold: false,
        }
    }
}

impl Look {
    fn of(cell: &vt100::Cell) -> Self {
        let default = if cell.dim() { DIM } else { FOREGROUND };
        let front = color(cell.fgcolor()).unwrap_or_else(|| default.into());
        let back = color(cell.bgcolor());
        let (front, back) = if cell.inverse() {
            (back.unwrap_or_else(|| BACKGROUND.into()), Some(front))
        } else {
            (front, back)
        };
        Self {
            front,
            back,
            is_bold: cell.bold(),
        }
    }
}

fn color(color: vt100::Color) -> Option<String> {
    match color {
        vt100::Color::Default => None,
        vt100::Color::Idx(index @ 0..16) => Some(COLORS[usize::from(index)].into()),
        vt100::Color::Idx(index @ 16..232) => {
            let level = |value: u8| if value == 0 { 0 } else { 55 + 40 * value };
            let [r, g, b] = [36, 6, 1].map(|unit| level((index - 16) / unit % 6));
            Some(format!("#{r:02x}{g:02x}{b:02x}"))
        }
        vt100::Color::Idx(index) => {
            let grey = 8 + 10 * (index - 232);
            Some(format!("#{grey:02x}{grey:02x}{grey:02x}"))
        }
        vt100::Color::Rgb(r, g, b) => Some(format!("#{r:02x}{g:02x}{b:02x}")),
    }
}

/// Cells beside each other that look the same.
struct Run {
    look: Look,
    column: u16,
    text: String,
}

impl Run {
    fn write(&self, row: u16, svg: &mut String) {
        let (x, y) = place(self.column, row);
        let columns = self.text.chars().count();
        if let Some(back) = &self.look.back {
            let width = columns * usize::from(CELL.0);
            let _ = writeln!(
                svg,
                "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{}\" fill=\"{back}\"/>",
                CELL.1
            );
        }
        // Words that are far apart are written apart, so that each part stands in its columns.
        let mut column = 0;
        for part in self.text.split_inclusive("  ") {
            let blanks = part.len() - part.trim_start_matches(' ').len();
            let text = part.trim_matches(' ');
            if !text.is_empty() {
                let at = usize::from(x) + (column + blanks) * usize::from(CELL.0);
                let width = text.chars().count() * usize::from(CELL.0);
                let bold = if self.look.is_bold {
                    " font-weight=\"bold\""
                } else {
                    ""
                };
                let text = text.replace('&', "&amp;").replace('<', "&lt;");
                let _ = writeln!(
                    svg,
                    "<text x=\"{at}\" y=\"{}\" textLength=\"{width}\" lengthAdjust=\"spacingAndGlyphs\" \
                     fill=\"{}\"{bold}>{text}</text>",
                    y + 12,
                    self.look.front
                );
            }
            column += part.chars().count();
        }
    }
}

fn place(column: u16, row: u16) -> (u16, u16) {
    (BORDER + column * CELL.0, BORDER + row * CELL.1)
}

/// Returns the pattern of a character that is braille.
fn braille(text: &str) -> Option<u32> {
    let pattern = u32::from(text.chars().next()?).checked_sub(0x2800)?;
    (pattern < 0x100).then_some(pattern)
}

fn put_dots(path: &mut String, pattern: u32, column: u16, row: u16) {
    let (x, y) = place(column, row);
    for (bit, (right, down)) in [
        (0, 0),
        (0, 1),
        (0, 2),
        (1, 0),
        (1, 1),
        (1, 2),
        (0, 3),
        (1, 3),
    ]
    .into_iter()
    .enumerate()
    {
        if pattern & (1 << bit) != 0 {
            let _ = write!(path, "M{} {}h0", x + 2 + 4 * right, y + 2 + 4 * down);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_has_its_place_colour_and_weight() {
        let svg = of("\x1b[1;31mred\x1b[0m  a<b\n\x1b[7mback", 12, 2);
        assert!(
            svg.contains("fill=\"#e5534b\" font-weight=\"bold\">red</text>"),
            "{svg}"
        );
        assert!(
            svg.contains("<text x=\"48\" y=\"20\" textLength=\"24\""),
            "{svg}"
        );
        assert!(svg.contains(">a&lt;b</text>"), "{svg}");
        let back =
            format!("<rect x=\"8\" y=\"24\" width=\"32\" height=\"16\" fill=\"{FOREGROUND}\"/>");
        assert!(svg.contains(&back), "{svg}");
    }

    #[test]
    fn braille_is_drawn_as_dots() {
        let svg = of("\x1b[36m⢁", 2, 1);
        assert!(
            svg.contains("<path d=\"M10 10h0M14 22h0\" stroke=\"#39c5cf\""),
            "{svg}"
        );
        assert!(!svg.contains("<text"), "{svg}");
    }
}
