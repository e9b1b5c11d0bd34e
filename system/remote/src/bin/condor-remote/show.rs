//! The output of commands.

use std::io::{Write, stdout};

use condor_remote::wire::RemoteTopic;
use serde_json::{Value as Json, json};

use crate::AnyError;

/// Prints values, one a line.
pub(crate) fn values(json: bool, values: Vec<Json>) -> Result<(), AnyError> {
    let mut out = stdout().lock();
    if json {
        writeln!(out, "{}", Json::from(values))?;
        return Ok(());
    }
    for value in values {
        writeln!(out, "{}", text(&value))?;
    }
    Ok(())
}

/// Prints the state of processors and services, as `condor ps` does.
pub(crate) fn status(json: bool, status: &Json) -> Result<(), AnyError> {
    let mut out = stdout().lock();
    if json {
        return Ok(writeln!(out, "{status}")?);
    }
    let (system, pid) = (text(&status["system"]), text(&status["pid"]));
    let uptime = status["uptime"].as_f64().unwrap_or_default();
    writeln!(out, "{system}: up {uptime:.0} s, process {pid}")?;
    let rows = status["processors"].as_array().cloned().unwrap_or_default();
    let rows = rows.into_iter().map(|mut row| {
        row["mailbox"] = row["heart"]["presence"].take();
        row["incarnation"] = row["heart"]["incarnation"].take();
        let terminals = row["terminals"].as_array().into_iter().flatten();
        let lost = terminals.map(|it| it["lost"].as_u64().unwrap_or_default());
        row["lost on tty"] = lost.reduce(|sum, lost| sum + lost).into();
        row
    });
    let columns = [
        "number",
        "name",
        "kind",
        "state",
        "mailbox",
        "incarnation",
        "pid",
        "restarts",
        "loops",
        "lost on tty",
        "last_exit",
    ];
    table(&columns, &rows.collect::<Vec<_>>())
}

/// Prints topics.
pub(crate) fn topics(json: bool, topics: &[RemoteTopic]) -> Result<(), AnyError> {
    if json {
        return values(true, vec![json!(topics)]);
    }
    let rows: Vec<_> = topics
        .iter()
        .map(|topic| json!({ "topic": topic.name, "type": topic.schema_name }))
        .collect();
    table(&["topic", "type"], &rows)
}

/// Prints variables and parameters, as `condor vars list` and `condor vars get` do.
pub(crate) fn variables(json: bool, rows: Vec<Json>) -> Result<(), AnyError> {
    if json {
        writeln!(stdout(), "{}", json!({ "variables": rows }))?;
        return Ok(());
    }
    let rows = rows.into_iter().map(|mut row| {
        let owner = if row["cell"].is_null() {
            "loop"
        } else {
            "cell"
        };
        row["in"] = row[owner].take();
        let labels = row["labels"].as_array().into_iter().flatten();
        let labels: Vec<_> = labels.map(text).collect();
        row["can be set to"] = match row["bounds"].take() {
            Json::Array(_) if !labels.is_empty() => labels.join(", ").into(),
            bounds => bounds,
        };
        row
    });
    let columns = [
        "processor",
        "in",
        "name",
        "value",
        "unit",
        "type",
        "can be set to",
        "about",
    ];
    table(&columns, &rows.collect::<Vec<_>>())
}

/// Prints that a parameter was set.
pub(crate) fn change(json: bool, name: &str, before: &Json, value: &Json) -> Result<(), AnyError> {
    let mut out = stdout();
    if json {
        let change = json!({ "name": name, "before": before, "value": value });
        return Ok(writeln!(out, "{change}")?);
    }
    Ok(writeln!(
        out,
        "{name}: {} -> {}",
        text(before),
        text(value)
    )?)
}

/// Prints some fields of objects in columns.
fn table(columns: &[&str], rows: &[Json]) -> Result<(), AnyError> {
    let head = columns
        .iter()
        .map(|&column| column.replace('_', " "))
        .collect();
    let cells = rows
        .iter()
        .map(|row| columns.iter().map(|&column| text(&row[column])).collect());
    let lines: Vec<Vec<String>> = core::iter::once(head).chain(cells).collect();
    let width = |column: usize| {
        lines
            .iter()
            .filter_map(|line| line.get(column))
            .map(|cell| cell.chars().count())
            .max()
    };
    let widths: Vec<_> = (0..columns.len())
        .map(|column| width(column).unwrap_or(0))
        .collect();
    let mut out = stdout().lock();
    for line in &lines {
        let cells = line
            .iter()
            .zip(&widths)
            .map(|(cell, &width)| format!("{cell:width$}"));
        let cells: Vec<_> = cells.collect();
        writeln!(out, "{}", cells.join("  ").trim_end())?;
    }
    Ok(())
}

/// A value for people. Names that programs have chosen cannot control the terminal.
fn text(value: &Json) -> String {
    let text = match value {
        Json::Null => "-".into(),
        Json::String(text) => text.clone(),
        Json::Array(values) => values.iter().map(text).collect::<Vec<_>>().join(" to "),
        value => value.to_string(),
    };
    text.chars()
        .map(|letter| {
            if letter.is_control() {
                '\u{fffd}'
            } else {
                letter
            }
        })
        .collect()
}
