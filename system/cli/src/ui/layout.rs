//! The places of windows and tables.

use ratatui::layout::{Constraint, Layout as Split, Rect};
use ratatui::widgets::{Block, Borders};

use super::model::{Model, Page};

/// From this size on all windows and tables are seen at once; plots are alone.
const WIDE: u16 = 160;
const HIGH: u16 = 40;
/// Columns of the tables beside windows.
const TABLES: u16 = 84;

/// The places of all parts of the screen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) tabs: Vec<(Page, String, Rect)>,
    pub(super) panes: Vec<(Page, Rect)>,
    pub(super) status: Rect,
}

impl Layout {
    /// The part of each page that is inside of its borders.
    pub(super) fn insides(&self) -> impl Iterator<Item = (Page, Rect)> + '_ {
        let is_alone = self.panes.len() == 1;
        self.panes.iter().map(move |(page, area)| {
            let block = Block::new().borders(borders(*page, is_alone));
            (*page, block.inner(*area))
        })
    }

    /// Returns the page at a place of the screen.
    pub(super) fn page_at(&self, column: u16, row: u16) -> Option<Page> {
        let place = ratatui::layout::Position::new(column, row);
        let mut tabs = self.tabs.iter();
        let tab = tabs.find(|(.., area)| area.contains(place));
        let mut panes = self.panes.iter();
        let pane = panes.find(|(_, area)| area.contains(place));
        tab.map(|(page, ..)| *page).or(pane.map(|(page, _)| *page))
    }
}

/// The borders of a page: a window that is alone has its title, and all columns.
pub(super) fn borders(page: Page, is_alone: bool) -> Borders {
    if is_alone && matches!(page, Page::Window(_)) {
        Borders::TOP
    } else {
        Borders::ALL
    }
}

pub(super) fn layout(area: Rect, model: &Model) -> Layout {
    let rows = [
        Constraint::Length(1),
        Constraint::Min(1),
        Constraint::Length(1),
    ];
    let [bar, body, status] = Split::vertical(rows).areas(area);
    let is_large =
        area.width >= WIDE && area.height >= HIGH && !model.zoomed && model.focus != Page::Plots;
    Layout {
        tabs: tabs(bar, model),
        panes: if is_large {
            tiled(body, model)
        } else {
            vec![(model.focus, body)]
        },
        status,
    }
}

/// Sets the sizes of the windows for a screen of this size.
pub(super) fn resize(model: &mut Model, columns: u16, rows: u16) {
    model.area = Rect::new(0, 0, columns, rows);
    for (page, inner) in layout(model.area, model).insides() {
        if let Page::Window(id) = page {
            model.with(id, |window| window.resize(inner.width, inner.height));
        }
    }
}

/// Names as long as there is room for.
fn tabs(bar: Rect, model: &Model) -> Vec<(Page, String, Rect)> {
    let mut longest = 16;
    loop {
        let labels: Vec<(Page, String)> = model
            .pages()
            .map(|page| (page, label(model, page, longest)))
            .collect();
        let width: usize = labels
            .iter()
            .map(|(_, label)| label.chars().count() + 1)
            .sum();
        if width <= usize::from(bar.width) || longest <= 2 {
            return place(bar, labels);
        }
        longest -= 1;
    }
}

fn place(bar: Rect, labels: Vec<(Page, String)>) -> Vec<(Page, String, Rect)> {
    let mut x = bar.x;
    let mut tabs = Vec::new();
    for (page, label) in labels {
        let width = u16::try_from(label.chars().count()).unwrap_or(u16::MAX);
        let area = Rect::new(x, bar.y, width, 1).intersection(bar);
        x = x.saturating_add(width).saturating_add(1);
        tabs.push((page, label, area));
    }
    tabs
}

fn label(model: &Model, page: Page, longest: usize) -> String {
    let name = match page {
        Page::Window(id) => {
            let place = model.windows.iter().position(|window| window.id == id);
            let window = place.and_then(|place| model.windows.get(place));
            let name = window.map_or("", |window| window.title.as_str());
            let name: String = name.chars().take(longest).collect();
            return format!("{}:{name}", place.unwrap_or(0) + 1);
        }
        Page::Loops => "Loops",
        Page::Messages => "Messages",
        Page::Files => "Files",
        Page::Log => "Log",
        Page::Plots => "Plots",
    };
    name.chars().take(longest.max(3)).collect()
}

fn tiled(body: Rect, model: &Model) -> Vec<(Page, Rect)> {
    let columns = [Constraint::Min(1), Constraint::Length(TABLES)];
    let [left, right] = Split::horizontal(columns).areas(body);
    let mut panes = Vec::new();
    let across = if model.windows.len() <= 2 { 1 } else { 2 };
    // The first has a row alone if the number is odd: it is where people type.
    let (first, others) = model.windows.split_at(model.windows.len() % across);
    let groups = first.chunks(1).chain(others.chunks(across));
    let rows = Split::vertical(vec![Constraint::Fill(1); groups.clone().count()]).split(left);
    for (windows, row) in groups.zip(rows.iter()) {
        let cells = Split::horizontal(vec![Constraint::Fill(1); windows.len()]).split(*row);
        for (window, cell) in windows.iter().zip(cells.iter()) {
            panes.push((Page::Window(window.id), *cell));
        }
    }
    let loops = u16::try_from(model.loops.len()).unwrap_or(u16::MAX);
    let rows = [
        Constraint::Length(loops.saturating_add(3).clamp(4, 12)),
        Constraint::Fill(2),
        Constraint::Length(8),
        Constraint::Fill(1),
    ];
    let areas: [Rect; 4] = Split::vertical(rows).areas(right);
    panes.extend(Page::TABLES.into_iter().zip(areas));
    panes
}
