//! Draws a [`Plot`].

mod front;
mod pane;
mod time;

pub(crate) use pane::seen;

use ratatui::buffer::Buffer;
use ratatui::layout::{Constraint, Layout, Rect};

use super::model::{Plot, RobotPane};

/// Columns of the axis of values.
const AXIS: u16 = 10;
/// The narrowest area that has room for plots and the robot beside each other.
const BESIDE: u16 = 60;

/// Draws all of a plot into `area`.
pub(crate) fn draw(plot: &Plot, area: Rect, buffer: &mut Buffer) {
    let (plots, robot) = split(plot, area);
    if let (Some(area), Some(figure)) = (robot, &plot.figure) {
        let at = plot.told_ns();
        let value = |curve| {
            let known = plot.history(curve)?.at(at);
            known.map(|(low, high)| f64::midpoint(low, high))
        };
        figure.draw(value, plot.has_colors, area, buffer);
    }
    if let Some(area) = plots {
        let rows = [Constraint::Fill(1), Constraint::Length(1)];
        let [panes, axis] = Layout::vertical(rows).areas(area);
        let time = time::Time::of(plot, area.width.saturating_sub(AXIS));
        let areas = Layout::vertical(vec![Constraint::Fill(1); plot.panes.len()]).split(panes);
        for (number, area) in areas.iter().enumerate() {
            pane::draw(plot, number, time, *area, buffer);
        }
        time.draw_axis(plot, axis, buffer);
    }
    // Popups have all of the screen, since a tile may have too few lines.
    front::draw(plot, *buffer.area(), buffer);
}

/// Returns the areas of the plots and of the robot.
fn split(plot: &Plot, area: Rect) -> (Option<Rect>, Option<Rect>) {
    match plot.place {
        RobotPane::Hidden => (Some(area), None),
        RobotPane::Beside if area.width >= BESIDE => {
            let columns = [Constraint::Fill(3), Constraint::Fill(2)];
            let [plots, robot] = Layout::horizontal(columns).spacing(2).areas(area);
            (Some(plots), Some(robot))
        }
        RobotPane::Beside | RobotPane::Alone => (None, Some(area)),
    }
}

#[cfg(test)]
mod tests;
