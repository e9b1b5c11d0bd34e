//! The tables, as lines.

use ratatui::style::Stylize;
use ratatui::text::Line;

use crate::table::{Left, Right, Table, or_dash};
use crate::ui::log;
use crate::ui::model::{Model, Page};
use crate::view::{LoopRates, VectorCounts};
use condor_rt::numbers::FILES;

/// What stays above a table, and its rows in so many columns.
pub(super) fn lines(model: &Model, page: Page, width: u16) -> (Vec<Line<'_>>, Vec<Line<'_>>) {
    if page == Page::Log {
        let rows = log::rows(&model.log, width).into_iter();
        return (Vec::new(), rows.map(Line::raw).collect());
    }
    let mut head = Vec::new();
    if let Some(why) = &model.blind {
        head.push(Line::raw(format!("The counts cannot be read: {why}")).red());
    }
    let text = match page {
        Page::Loops => loops(&model.loops),
        Page::Messages => vectors(&model.vectors),
        _ => files(model),
    };
    let mut rows = text.lines().map(|line| Line::raw(line.to_owned()));
    if page != Page::Files {
        head.extend(rows.next().map(Stylize::bold));
    }
    (head, rows.collect())
}

fn loops(loops: &[(String, LoopRates)]) -> String {
    let mut table = Table::new([
        ("processor", Left),
        ("loop", Left),
        ("Hz", Right),
        ("reached", Right),
        ("run µs", Right),
        ("worst", Right),
        ("use %", Right),
        ("late µs", Right),
        ("overruns", Right),
    ])
    .with_gap(1);
    for (processor, rates) in loops {
        let state = if rates.faulted {
            " FAULT"
        } else if rates.enabled {
            ""
        } else {
            " off"
        };
        table.row([
            processor.clone(),
            format!("{}{state}", rates.name),
            rates.rate_hz.to_string(),
            or_dash(rates.reached_hz.map(|rate| format!("{rate:.1}"))),
            format!("{:.1}", rates.run_us),
            format!("{:.1}", rates.worst_run_us),
            or_dash(rates.utilisation.map(|part| format!("{:.2}", 100.0 * part))),
            format!("{:.1}", rates.worst_lateness_us),
            rates.overruns.to_string(),
        ]);
    }
    table.to_string()
}

fn vectors(vectors: &[(String, VectorCounts)]) -> String {
    let mut table = Table::new([
        ("processor", Left),
        ("vector", Right),
        ("name", Left),
        ("handled", Right),
        ("worst µs", Right),
        ("sent", Right),
        ("failed", Right),
    ])
    .with_gap(1);
    for (processor, counts) in vectors {
        let has_handler = !counts.name.is_empty();
        let handled = |text: String| if has_handler { text } else { "-".into() };
        table.row([
            processor.clone(),
            counts.vector.to_string(),
            handled(counts.name.clone()),
            handled(counts.handled.to_string()),
            handled(format!("{:.1}", counts.worst_us)),
            counts.sent.to_string(),
            counts.failed.to_string(),
        ]);
    }
    table.to_string()
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
