//! Scrolls the page of a window or table.

use ratatui::layout::Rect;

use super::layout::inside;
use super::log;
use super::model::{Model, Page};
use crate::counts::note_of_loops;

/// Scrolls a page: up for numbers above 0.
pub(super) fn scroll(model: &mut Model, page: Page, lines: i32) {
    if let Page::Window(id) = page {
        return model.with(id, |window| window.scroll(lines));
    }
    if page == Page::Plots {
        return model.plot.zoom(-lines);
    }
    // The log is scrolled from its end on, and tables from their beginning.
    let lines = if page == Page::Log { lines } else { -lines };
    let Rect { width, height, .. } = inside(page, model);
    let (rows, titles) = match page {
        Page::Loops => {
            let note = note_of_loops(&model.loops).lines().count();
            (model.loops.len() + note, 1)
        }
        Page::Messages => (model.vectors.len(), 1),
        Page::Files => (0, 0),
        _ => (log::rows(&model.log, model.least, width).len(), 0),
    };
    let most = (rows + titles).saturating_sub(height.into());
    let place = Page::TABLES.iter().position(|table| *table == page);
    if let Some(at) = place.and_then(|place| model.scrolled.get_mut(place)) {
        let to = i32::try_from(*at).unwrap_or(0).saturating_add(lines);
        *at = usize::try_from(to).unwrap_or(0).min(most);
    }
}
