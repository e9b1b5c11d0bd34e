//! The popups in front of a plot: help, and the text that is being typed.

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Stylize;
use ratatui::text::Line;

use crate::plot::model::{Plot, Prompt};
use crate::screen::{field, popup, wrapped};
use condor_host::plain::plain;

/// The least columns of what is in front.
const LEAST: u16 = 40;
/// The keys, as help shows them.
const HELP: &str = "\
n  p  x      choose the variables of the pane; a further
             pane; remove the pane
Tab          the next pane
← →          back and on in time, or move the cursor
+ -          zoom in time
Space  End   pause and go on; the newest values
c            cursor, whose values the legend tells
t            trigger: NAME>LEVEL or NAME<LEVEL, ~WIDTH
             is its hysteresis; nothing: no trigger
↑ ↓  [ ]  y  move and stretch the range of values; fix
             it, or let it follow the values
r            the robot beside the plots, alone, hidden
a d w s      turn the robot
q            leave

Any key closes this help.";

/// Names that are shown of those that fit what is typed.
const NAMES: usize = 8;

pub(super) fn draw(plot: &Plot, area: Rect, buffer: &mut Buffer) {
    let (title, about) = match plot.prompt {
        None => return,
        Some(Prompt::Help) => {
            let lines = HELP.lines().map(Line::raw).collect();
            return popup(" Plots ", lines, LEAST, area, buffer);
        }
        Some(Prompt::Names) => (" Variables of the pane ", "names, or patterns with * and ?"),
        Some(Prompt::NewPane) => (" A further pane ", "names, or patterns with * and ?"),
        Some(Prompt::Trigger) => (" Trigger ", "NAME>LEVEL or NAME<LEVEL; ~WIDTH: hysteresis"),
    };
    let mut lines = vec![Line::raw(about).dim(), field(&plot.typed, area)];
    let fitting = plot.fitting();
    lines.extend(
        fitting
            .iter()
            .take(NAMES)
            .map(|name| Line::raw(format!("  {}", plain(name)))),
    );
    if fitting.len() > NAMES {
        lines.push(Line::raw(format!("  … {} more", fitting.len() - NAMES)).dim());
    }
    if let Some(notice) = &plot.notice {
        let notice = wrapped(&plain(notice), area.width.saturating_sub(4), 0);
        lines.extend(notice.into_iter().map(|line| Line::raw(line).yellow()));
    }
    lines.push(Line::raw("Enter: take it; Tab: complete; Esc: cancel").dim());
    popup(title, lines, LEAST, area, buffer);
}
