//! Draws the screen of a terminal.

use std::borrow::Cow;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};

use condor_host::plain::plain;

/// Draws what is on `screen` into `area`; without a cursor, which the caller places.
pub(super) fn draw(screen: &vt100::Screen, area: Rect, buffer: &mut Buffer) {
    for row in 0..area.height {
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
                to.set_style(style(cell));
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
