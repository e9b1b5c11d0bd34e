//! The popups in front: help, actions, and the ways to leave.

use ratatui::Frame;
use ratatui::style::Stylize;
use ratatui::text::Line;

use crate::screen::{field, popup};
use crate::ui::menu::{Entry, entries};
use crate::ui::model::{Model, Popup};
use condor_host::error::me;

const HELP: &str = "\
What you type goes to the window in front, except

 F1          this help; also ? in tables
 F2          actions: tools, the simulated clock; start,
             restart, stop or load a program
 F3  F4      window to the left, to the right
 Alt-1 …     window of this number
 F5          show this window alone, or all again
 F6          search in a window or the log
 PgUp PgDn   scroll in earlier output
 F10         leave; also q in tables

 Mouse: click a window or its name; wheel
 scrolls; right button: actions

 In tables: arrows or j k scroll, Tab shows
 the next page, a opens actions
 In the log: l chooses the level (! warning,
 ✗ failure), / searches
 In plots: F1 lists their keys

Any key closes this help.";

pub(super) fn draw(frame: &mut Frame<'_>, model: &Model, popup: Popup) {
    match popup {
        Popup::Help => {
            let lines = HELP.lines().map(Line::raw).collect();
            show(frame, " Help ", lines);
        }
        Popup::Leave => {
            let (system, me) = (&model.system, me());
            let lines = if model.gone.is_some() {
                vec![
                    Line::raw(format!("l  leave; the system `{system}` has ended")),
                    Line::raw("Esc  stay"),
                ]
            } else {
                vec![
                    Line::raw(format!("l  leave; the system `{system}` keeps running,")),
                    Line::raw(format!("   and `{me} ui` shows it again")),
                    Line::raw("d  stop the system and leave"),
                    Line::raw("Esc  stay"),
                ]
            };
            show(frame, " Leave ", lines);
        }
        // Its line is the status line.
        Popup::Search => {}
        Popup::Menu { member, entry } => menu(frame, model, member, entry),
        Popup::Program { member } => program(frame, model, member),
        Popup::Confirm { member, order } => {
            let member = model.members.get(member);
            let name = member.map_or("", |member| &member.name);
            let lines = vec![
                Line::raw(format!("y  {order} `{name}`; its program ends now")),
                Line::raw("Esc  keep it running"),
            ];
            show(frame, &format!(" {order}? "), lines);
        }
        Popup::Step => {
            let lines = vec![
                Line::raw("Type how much time passes, such as 2500us or 10s").bold(),
                field(&model.typed, frame.area()),
                Line::raw("Enter: step, then stop the time; Esc: cancel").dim(),
            ];
            show(frame, " Step ", lines);
        }
    }
}

fn menu(frame: &mut Frame<'_>, model: &Model, member: usize, entry: usize) {
    let Some(member) = model.members.get(member) else {
        return;
    };
    let text = |entry| match entry {
        Entry::Order(order) => order.to_owned(),
        Entry::Pause => "pause the clock".to_owned(),
        Entry::Resume => "resume the clock".to_owned(),
        Entry::Step => "step the clock …".to_owned(),
        Entry::Tool(tool) => {
            let command = tool.filled(&me(), &model.system, member);
            format!("{}: {}", tool.name, command.as_deref().unwrap_or("-"))
        }
    };
    let mut lines = vec![Line::raw(format!("{} is {}", member.name, member.state)).bold()];
    for (place, text) in entries(model, member).map(text).enumerate() {
        let line = Line::raw(format!(" {text} "));
        lines.push(if place == entry {
            line.reversed()
        } else {
            line
        });
    }
    lines.push(Line::raw("Up, Down: choose; Enter: do it; Esc: close;").dim());
    lines.push(Line::raw("Left, Right: another processor").dim());
    show(frame, " Actions ", lines);
}

fn program(frame: &mut Frame<'_>, model: &Model, member: usize) {
    let Some(member) = model.members.get(member) else {
        return;
    };
    let lines = vec![
        Line::raw(format!(
            "Type a program for {}, then its arguments",
            member.name
        ))
        .bold(),
        field(&model.typed, frame.area()),
        Line::raw("Enter: load and start it; Esc: cancel").dim(),
    ];
    show(frame, " Load ", lines);
}

fn show(frame: &mut Frame<'_>, title: &str, lines: Vec<Line<'_>>) {
    popup(title, lines, 0, frame.area(), frame.buffer_mut());
}
