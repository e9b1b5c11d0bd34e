//! Searches what the log, or a terminal, has shown; capitals are as small letters.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Modifier;

use super::layout::inside;
use super::log::{self, Level};
use super::model::{Model, Page};
use super::scroll::scroll;

/// Scrolls the page in front to the next line with the text that is typed, above what is seen or below.
pub(super) fn search(model: &mut Model, is_up: bool) {
    let area = inside(model.focus, model);
    let (rows, below) = match model.focus {
        Page::Window(id) => {
            let Some(window) = model.window_mut(id) else {
                return;
            };
            (window.rows(), window.screen().scrollback())
        }
        page => {
            let rows = log::rows(&model.log, model.least, area.width).into_iter();
            (rows.map(|(_, row)| row).collect(), model.scroll_of(page))
        }
    };
    let text = model.typed.value().to_lowercase();
    let has = |row: &String| row.to_lowercase().contains(&text);
    let height = usize::from(area.height);
    let end = rows.len().saturating_sub(below);
    let found = if is_up {
        let mut above = rows.iter().take(end.saturating_sub(height));
        above.rposition(has)
    } else {
        let mut under = rows.iter().skip(end);
        under.position(has).map(|place| end + place)
    };
    model.notice = match found {
        Some(place) if !text.is_empty() => {
            // The line is in the middle, if there are enough lines below.
            let to = (rows.len() - place).saturating_sub(height.div_ceil(2));
            let lines = to.cast_signed() - below.cast_signed();
            scroll(model, model.focus, i32::try_from(lines).unwrap_or(0));
            None
        }
        _ => {
            let place = if is_up { "earlier" } else { "later" };
            let hidden = match (model.focus, model.least) {
                (Page::Log, Level::Warning | Level::Failure) => {
                    " of those that are shown; `l` shows more"
                }
                _ => "",
            };
            Some(format!("no {place} line has it{hidden}"))
        }
    };
}

/// Marks a text wherever it is seen in `area`.
pub(super) fn mark(text: &str, area: Rect, buffer: &mut Buffer) {
    let text = text.to_lowercase();
    for row in area.top()..area.bottom() {
        for column in area.left()..area.right() {
            let mut rest = text.as_str();
            let mut end = column;
            while !rest.is_empty() && end < area.right() {
                let letter = buffer[(end, row)].symbol().to_lowercase();
                let Some(behind) = rest.strip_prefix(&letter) else {
                    break;
                };
                (rest, end) = (behind, end + 1);
            }
            if rest.is_empty() {
                for cell in column..end {
                    buffer[(cell, row)].modifier.insert(Modifier::REVERSED);
                }
            }
        }
    }
}
