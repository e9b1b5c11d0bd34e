//! The places of windows and tables.

use ratatui::layout::{Constraint, Layout as Split, Rect};
use ratatui::widgets::{Block, Borders};

use super::feed::UiEvent;
use super::model::{Model, Page};
use crate::screen::wrapped;

/// From this size on, plots, the page in front and the log are seen at once.
const TILED: (u16, u16) = (120, 36);
/// From this size on, plots, the window in front and all tables are seen at once.
const LARGE: (u16, u16) = (166, 40);
/// Columns of the tables beside others, or of the page in front beside the log.
const TABLES: u16 = 84;

/// The places of all parts of the screen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) tabs: Vec<(Page, String, Rect)>,
    /// The room for the caption of a demonstration; none without one.
    pub(super) caption: Rect,
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
    let caption = match model.caption.as_str() {
        "" => 0,
        caption => wrapped(caption, area.width, 0).len(),
    };
    let rows = [
        Constraint::Length(1),
        Constraint::Length(u16::try_from(caption).unwrap_or(u16::MAX)),
        Constraint::Min(1),
        Constraint::Length(1),
    ];
    let [bar, caption, body, status] = Split::vertical(rows).areas(area);
    let has = |(columns, rows)| area.width >= columns && area.height >= rows;
    Layout {
        tabs: tabs(bar, model),
        caption,
        panes: if model.zoomed || !has(TILED) {
            vec![(model.focus, body)]
        } else if has(LARGE) {
            all(body, model)
        } else {
            some(body, model)
        },
        status,
    }
}

impl Model {
    /// Whether what came changes what is on the screen.
    pub(super) fn is_seen(&self, news: &UiEvent) -> bool {
        !matches!(news, UiEvent::Plot(_)) || self.sees_plots()
    }

    pub(super) fn sees_plots(&self) -> bool {
        let panes = layout(self.area, self).panes;
        panes.iter().any(|(page, _)| *page == Page::Plots)
    }

    /// Has the plots begin when a person first sees them; returns true if they do.
    pub(super) fn begin_plots(&mut self) -> bool {
        let is_tile = layout(self.area, self).panes.len() > 1;
        self.sees_plots() && self.plot.begin(is_tile)
    }
}

/// Returns the area of a page inside of its borders; that of a small screen if it is not seen.
pub(super) fn inside(page: Page, model: &Model) -> Rect {
    let layout = layout(model.area, model);
    let found = layout.insides().find(|(other, _)| *other == page);
    found.map_or(Rect::new(0, 0, 80, 20), |(_, area)| area)
}

/// Sets the sizes of the windows for a screen of this size.
pub(super) fn resize(model: &mut Model, columns: u16, rows: u16) {
    model.area = Rect::new(0, 0, columns, rows);
    // Keys go elsewhere.
    if model.focus != Page::Plots {
        model.plot.prompt = None;
    }
    if matches!(model.focus, Page::Window(_)) {
        model.front = model.focus;
    }
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
    let name = name(model, page).chars();
    let Page::Window(id) = page else {
        return name.take(longest.max(3)).collect();
    };
    let place = model.windows.iter().position(|window| window.id == id);
    let name: String = name.take(longest).collect();
    format!("{}:{name}", place.unwrap_or(0) + 1)
}

/// Returns the name of a page, which is the title of a window.
pub(super) fn name(model: &Model, page: Page) -> &str {
    match page {
        Page::Window(id) => model.window(id).map_or("", |window| &window.title),
        Page::Loops => "Loops",
        Page::Messages => "Messages",
        Page::Files => "Files",
        Page::Log => "Log",
        Page::Plots => "Plots",
    }
}

/// Plots above the page in front and the log.
fn some(body: Rect, model: &Model) -> Vec<(Page, Rect)> {
    let rows = [Constraint::Fill(2), Constraint::Fill(3)];
    let [plots, below] = Split::vertical(rows).areas(body);
    let columns = [Constraint::Length(TABLES), Constraint::Min(1)];
    let [front, log] = Split::horizontal(columns).areas(below);
    let page = match model.focus {
        Page::Log | Page::Plots => model.front,
        page => page,
    };
    // Plots come last, because their popups are in front of all.
    vec![(page, front), (Page::Log, log), (Page::Plots, plots)]
}

/// Plots above the window in front, and all tables beside them.
fn all(body: Rect, model: &Model) -> Vec<(Page, Rect)> {
    let columns = [Constraint::Min(1), Constraint::Length(TABLES)];
    let [left, right] = Split::horizontal(columns).areas(body);
    let [plots, front] = Split::vertical([Constraint::Fill(1); 2]).areas(left);
    let loops = u16::try_from(model.loops.len()).unwrap_or(u16::MAX);
    let rows = [
        Constraint::Length(loops.saturating_add(3).clamp(4, 12)),
        Constraint::Fill(2),
        Constraint::Length(8),
        Constraint::Fill(1),
    ];
    let areas: [Rect; 4] = Split::vertical(rows).areas(right);
    let mut panes = vec![(model.front, front)];
    panes.extend(Page::TABLES.into_iter().zip(areas));
    panes.push((Page::Plots, plots));
    panes
}
