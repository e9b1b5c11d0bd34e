//! The tables, as lines.

use ratatui::style::Stylize;
use ratatui::text::Line;

use crate::counts::{note_of_loops, table_of_loops, table_of_vectors};
use crate::table::or_dash;
use crate::ui::log::{self, Level};
use crate::ui::model::{Model, Page};
use condor_rt::numbers::FILES;

/// Returns the lines that stay above a table, and its rows, for a table of `width` columns.
pub(super) fn lines(model: &Model, page: Page, width: u16) -> (Vec<Line<'_>>, Vec<Line<'_>>) {
    if page == Page::Log {
        let rows = log::rows(&model.log, model.least, width).into_iter();
        let rows = rows.map(|(level, row)| match level {
            Level::Information => Line::raw(row),
            Level::Warning => Line::raw(row).yellow(),
            Level::Failure => Line::raw(row).red(),
        });
        return (Vec::new(), rows.collect());
    }
    let mut head = Vec::new();
    if let Some(why) = &model.blind {
        head.push(Line::raw(format!("The counts cannot be read: {why}")).red());
    }
    let text = match page {
        Page::Loops => {
            let table = table_of_loops(&model.loops).with_gap(1);
            format!("{table}{}", note_of_loops(&model.loops))
        }
        Page::Messages => table_of_vectors(&model.vectors).with_gap(1).to_string(),
        _ => files(model),
    };
    let mut rows = text.lines().map(|line| Line::raw(line.to_owned()));
    if page != Page::Files {
        head.extend(rows.next().map(Stylize::bold));
    }
    (head, rows.collect())
}

fn files(model: &Model) -> String {
    let root = model.files_root.as_deref().unwrap_or("nothing");
    let mut members = model.members.iter();
    let Some(service) = members.find(|member| member.number == FILES.0) else {
        return "The system has no file service.".into();
    };
    let per_second = model.served.per_second;
    let per_second = per_second.map_or(String::new(), |rate| format!(", {rate:.1} a second"));
    let mut text = format!(
        "serves    {root}\nstate     {}, process {}, {} restarts\nrequests  {}{per_second}\n",
        service.state,
        or_dash(service.pid),
        service.restarts,
        model.served.messages,
    );
    if let Some(exit) = &service.last_exit {
        text += "last exit ";
        text += exit;
        text.push('\n');
    }
    text
}
