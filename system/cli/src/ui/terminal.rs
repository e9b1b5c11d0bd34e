//! Draws the screen of a terminal.

use std::borrow::Cow;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};

use condor_host::plain::plain;

/// The beginning of a line by which a program says that a command failed.
const ERROR: &str = "error: ";

/// Draws what is on `screen` into `area`, errors in red; without a cursor, which the caller places.
pub(super) fn draw(screen: &vt100::Screen, area: Rect, buffer: &mut Buffer) {
    let mut is_error = false;
    for (row, text) in (0..area.height).zip(screen.rows(0, area.width)) {
        let goes_on = row > 0 && screen.row_wrapped(row - 1);
        is_error = text.starts_with(ERROR) || (is_error && goes_on);
        for column in 0..area.width {
            let Some(cell) = screen.cell(row, column) else {
                continue;
            };
            if cell.is_wide_continuation() {
                continue;
            }
            let place = (area.x + column, area.y + row);
            if let Some(to) = buffer.cell_mut(place) {
                let text = cell.contents();
                // A screen keeps what it does not obey itself.
                let is_shown = !text.is_empty() && matches!(plain(text), Cow::Borrowed(_));
                to.set_symbol(if is_shown { text } else { " " });
                let mut style = style(cell);
                if is_error && cell.fgcolor() == vt100::Color::Default {
                    style = style.fg(Color::Red);
                }
                to.set_style(style);
            }
        }
    }
}

fn style(cell: &vt100::Cell) -> Style {
    let modifiers = [
        (cell.bold(), Modifier::BOLD),
        (cell.dim(), Modifier::DIM),
        (cell.italic(), Modifier::ITALIC),
        (cell.underline(), Modifier::UNDERLINED),
        (cell.inverse(), Modifier::REVERSED),
    ];
    let set = modifiers.iter().filter(|(is_set, _)| *is_set);
    let style = Style::new()
        .fg(color(cell.fgcolor()))
        .bg(color(cell.bgcolor()));
    style.add_modifier(set.map(|(_, modifier)| *modifier).collect())
}

const fn color(color: vt100::Color) -> Color {
    match color {
        vt100::Color::Default => Color::Reset,
        vt100::Color::Idx(index) => Color::Indexed(index),
        vt100::Color::Rgb(red, green, blue) => Color::Rgb(red, green, blue),
    }
}
