//! Draws a [`Model`].

mod popups;
mod tables;

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout as Split, Position, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, BorderType, Borders, Clear, Paragraph};

use super::layout::{self, Layout};
use super::log::Level;
use super::model::{Model, Page, Popup};
use super::search;
use super::terminal;
use super::window::Window;
use crate::plot;
use crate::screen::{field, wrapped};
use condor_host::control::{ClockStatus, MemberState};
use condor_host::plain::plain;

/// The columns and rows of the smallest screen on which pages are drawn.
const LEAST: (u16, u16) = (40, 10);

pub(super) fn draw(frame: &mut Frame<'_>, model: &Model) {
    let area = frame.area();
    let (columns, rows) = LEAST;
    if area.width < columns || area.height < rows {
        let text = format!("Too small: this terminal needs {columns} × {rows} characters.");
        let lines = wrapped(&text, area.width, 0).into_iter().map(Line::raw);
        return frame.render_widget(Paragraph::new(lines.collect::<Vec<_>>()), area);
    }
    let layout = layout::layout(area, model);
    draw_tabs(frame, model, &layout);
    let caption = wrapped(&model.caption, area.width, 0)
        .into_iter()
        .map(Line::raw);
    let caption = Paragraph::new(caption.collect::<Vec<_>>());
    frame.render_widget(caption.bold().reversed(), layout.caption);
    let is_alone = layout.panes.len() == 1;
    for (page, area) in &layout.panes {
        draw_pane(frame, model, *page, *area, layout::borders(*page, is_alone));
    }
    draw_status(frame, model, layout.status);
    if let Some(popup) = model.popup {
        popups::draw(frame, model, popup);
    }
}

fn draw_tabs(frame: &mut Frame<'_>, model: &Model, layout: &Layout) {
    for (page, label, area) in &layout.tabs {
        let mut style = Style::new();
        if let Page::Window(id) = page
            && let Some(window) = model.window(*id)
        {
            style = style.fg(color(model, window));
        }
        if *page == model.focus {
            style = style.add_modifier(Modifier::REVERSED | Modifier::BOLD);
        }
        frame.render_widget(Span::styled(label.as_str(), style), *area);
    }
}

/// Returns the state of the processor of a window.
fn state(model: &Model, window: &Window) -> Option<MemberState> {
    let mut members = model.members.iter();
    let member = members.find(|member| member.number == window.processor);
    member.map(|member| member.state)
}

fn color(model: &Model, window: &Window) -> Color {
    match state(model, window) {
        Some(MemberState::Running) => Color::Green,
        Some(MemberState::Starting | MemberState::Restarting) => Color::Yellow,
        Some(MemberState::Stalled | MemberState::Failed | MemberState::Held) => Color::Red,
        _ => Color::DarkGray,
    }
}

fn draw_pane(frame: &mut Frame<'_>, model: &Model, page: Page, area: Rect, borders: Borders) {
    let is_focus = page == model.focus;
    let title = title(model, page);
    let mut block = Block::new().borders(borders).title(title);
    if is_focus {
        // The text of a window has styles of its own.
        let bold = Style::new().bold();
        block = block.border_type(BorderType::Thick).border_style(bold);
        block = block.title_style(bold);
    }
    let inner = block.inner(area);
    frame.render_widget(block, area);
    match page {
        Page::Window(id) => {
            if let Some(window) = model.window(id) {
                draw_window(frame, window, inner, is_focus && model.popup.is_none());
            }
        }
        Page::Plots => plot::draw(&model.plot, inner, frame.buffer_mut()),
        _ => draw_table(frame, model, page, inner),
    }
    if is_focus && model.popup == Some(Popup::Search) {
        search::mark(model.typed.value(), inner, frame.buffer_mut());
    }
}

fn draw_table(frame: &mut Frame<'_>, model: &Model, page: Page, inner: Rect) {
    let (head, rows) = tables::lines(model, page, inner.width);
    let split = [Constraint::Length(head.len() as u16), Constraint::Fill(1)];
    let [above, below] = Split::vertical(split).areas(inner);
    let scrolled = match page {
        // The last lines are at the bottom.
        Page::Log => rows
            .len()
            .saturating_sub(usize::from(below.height))
            .saturating_sub(model.scroll_of(page)),
        _ => model.scroll_of(page),
    };
    let scrolled = u16::try_from(scrolled).unwrap_or(u16::MAX);
    frame.render_widget(Paragraph::new(head), above);
    frame.render_widget(Paragraph::new(rows).scroll((scrolled, 0)), below);
}

fn title(model: &Model, page: Page) -> Line<'static> {
    let text = match page {
        Page::Window(id) => {
            let Some(window) = model.window(id) else {
                return Line::default();
            };
            let above = window.screen().scrollback();
            let above = if above > 0 {
                format!(", {above} lines back")
            } else {
                String::new()
            };
            let state = match state(model, window) {
                _ if window.is_tool && !window.is_connected() => "ended".into(),
                _ if window.is_tool => "on a terminal of its own".into(),
                Some(state) if window.is_connected() => state.to_string(),
                Some(state) => format!("{state}, no terminal"),
                None => "unknown".into(),
            };
            format!(" {}: {state}{above} ", window.title)
        }
        Page::Loops => " Servo loops ".into(),
        Page::Messages => " Messages per vector ".into(),
        Page::Files => " File service ".into(),
        Page::Log => match model.least {
            Level::Information => " Log ".into(),
            Level::Warning => " Log: warnings and failures ".into(),
            Level::Failure => " Log: failures ".into(),
        },
        Page::Plots => plain(&format!(" Plots: {}, F1 keys ", model.plot.state())).into_owned(),
    };
    Line::raw(text)
}

fn draw_window(frame: &mut Frame<'_>, window: &Window, area: Rect, has_cursor: bool) {
    let shown = window.screen();
    terminal::draw(shown, area, frame.buffer_mut());
    let (row, column) = shown.cursor_position();
    let is_seen = !shown.hide_cursor() && shown.scrollback() == 0;
    if has_cursor && is_seen && row < area.height && column < area.width {
        frame.set_cursor_position(Position::new(area.x + column, area.y + row));
    }
}

/// Draws the line at the bottom. A notice that is longer covers the lines above it.
fn draw_status(frame: &mut Frame<'_>, model: &Model, area: Rect) {
    if model.popup == Some(Popup::Search) {
        return draw_search(frame, model, area);
    }
    let Some((text, color)) = notice(model) else {
        return frame.render_widget(Line::raw(hint(model)).dim(), area);
    };
    let lines = wrapped(&text, area.width, 0).into_iter().map(Line::raw);
    let lines: Vec<Line<'_>> = lines.collect();
    let height = (lines.len() as u16).min(area.bottom());
    let area = Rect {
        y: area.bottom() - height,
        height,
        ..area
    };
    frame.render_widget(Clear, area);
    frame.render_widget(Paragraph::new(lines).fg(color), area);
}

fn notice(model: &Model) -> Option<(String, Color)> {
    if let Some(why) = &model.gone {
        return Some((format!("No supervisor (F10 leaves): {why}"), Color::Red));
    }
    let of_plots = model.plot.notice.as_ref();
    let of_plots = of_plots.filter(|_| model.sees_plots());
    let notice = model.notice.as_ref().or(of_plots)?;
    Some((plain(notice).into_owned(), Color::Yellow))
}

fn hint(model: &Model) -> String {
    let system = &model.system;
    match &model.clock {
        None => format!(
            "{system} {:.0} s  F1 help  F2 actions  F3 F4 windows  F5 zoom  F10 leave",
            model.uptime
        ),
        Some(clock) => format!(
            "{system} {}  F1 help  F2 actions  F10 leave",
            self::clock(clock)
        ),
    }
}

/// Draws the text that is searched for, and how.
fn draw_search(frame: &mut Frame<'_>, model: &Model, area: Rect) {
    let mut line = Line::raw("Search: ");
    let half = Rect {
        width: area.width / 2,
        ..area
    };
    line.extend(field(&model.typed, half));
    line.push_span(match &model.notice {
        Some(notice) => Span::raw(format!("  {notice}")).yellow(),
        None => Span::raw("  ↑ Enter: earlier; ↓: later; Esc: close").dim(),
    });
    frame.render_widget(line, area);
}

/// The simulated clock in few words.
fn clock(clock: &ClockStatus) -> String {
    let speed = match clock.speed {
        _ if clock.paused => "paused".into(),
        Some(speed) => format!("speed {speed}"),
        None => "speed max".into(),
    };
    format!("{:.1} s, {speed} ({:.2} ×)", clock.seconds, clock.factor)
}

#[cfg(test)]
mod tests;
