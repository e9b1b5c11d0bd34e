//! The levels of the log, and searching.

use super::*;
use crate::ui::log::Level;
use crate::ui::search::search;

const FAILURE: &str = "servo-b: failed: killed by SIGKILL; restart 1";
const WARNING: &str = "table: stalled: no heartbeat for 0.2 s";

fn say(model: &mut Model, text: &str) {
    let line = format!("2026-11-21T15:28:53.000000Z {text}");
    model.hear(UiEvent::Log(line));
}

/// The text that has a style.
fn styled(model: &mut Model, size: (u16, u16), has: impl Fn(&Style) -> bool) -> String {
    let cells = cells(model, size);
    let cells = cells.content.iter().filter(|cell| has(&cell.style()));
    cells.map(ratatui::buffer::Cell::symbol).collect()
}

fn is_reversed(style: &Style) -> bool {
    style.add_modifier.contains(Modifier::REVERSED)
}

#[test]
fn failures_and_warnings_differ_with_and_without_colours() {
    let mut model = model();
    say(&mut model, FAILURE);
    say(&mut model, WARNING);
    model.focus = Page::Log;
    let lines = picture(&mut model, SMALL);
    expect(&lines, &LOG);
    expect(&lines, &[&format!("15:28:53.000 ✗ {FAILURE}")]);
    expect(&lines, &[&format!("15:28:53.000 ! {WARNING}")]);
    // The tabs of windows have the colours of their states.
    model.windows.clear();
    let of_color = |model: &mut Model, color| {
        let text = styled(model, SMALL, |style| style.fg == Some(color));
        text.trim_end().to_owned()
    };
    let failure = of_color(&mut model, Color::Red);
    assert!(failure.ends_with(FAILURE) && !failure.contains(WARNING));
    let warning = of_color(&mut model, Color::Yellow);
    assert!(warning.ends_with(WARNING) && !warning.contains(FAILURE));
}

#[test]
fn the_log_shows_lines_from_a_level_on() {
    let mut model = model();
    say(&mut model, FAILURE);
    say(&mut model, WARNING);
    model.focus = Page::Log;
    let shown = |model: &mut Model| {
        let text = picture(model, SMALL).join("\n");
        [LOG[0], WARNING, FAILURE].map(|line| text.contains(line))
    };
    assert_eq!(shown(&mut model), [true; 3]);
    model.show_from(model.least.next());
    assert_eq!(shown(&mut model), [false, true, true]);
    let title = " Log: warnings and failures ";
    expect(&picture(&mut model, SMALL), &[title]);
    model.show_from(model.least.next());
    assert_eq!(shown(&mut model), [false, false, true]);
    expect(&picture(&mut model, SMALL), &[" Log: failures "]);
    model.show_from(model.least.next());
    assert_eq!(model.least, Level::Information);
}

#[test]
fn what_the_log_has_said_is_found() {
    let mut model = model();
    say(&mut model, FAILURE);
    for number in 0..100 {
        say(&mut model, &format!("number {number}"));
    }
    say(&mut model, "servo-b: Failed again");
    model.focus = Page::Log;
    model.popup = Some(Popup::Search);
    model.typed = "failed".into();
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["Search: failed▏", "Esc: close", "Failed again"]);
    assert!(styled(&mut model, SMALL, is_reversed).contains("Failed"));
    search(&mut model, true);
    expect(&picture(&mut model, SMALL), &[FAILURE, "number 3"]);
    search(&mut model, true);
    let lines = picture(&mut model, SMALL);
    expect(&lines, &[FAILURE, "no earlier line has it"]);
    search(&mut model, false);
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["Failed again", "number 99"]);
    search(&mut model, false);
    expect(&picture(&mut model, SMALL), &["no later line has it"]);
}

#[test]
fn what_a_terminal_has_shown_is_found() {
    let mut model = model();
    picture(&mut model, SMALL);
    let rows = (0..300).map(|row| match row {
        100 | 200 => format!("\r\nneedle {row}"),
        _ => format!("\r\nrow {row}"),
    });
    let text = rows.collect::<Vec<_>>().concat().into_bytes();
    model.hear(UiEvent::Output(WindowId(1), text));
    model.popup = Some(Popup::Search);
    model.typed = "NEEDLE".into();
    for (is_up, row) in [(true, 200), (true, 100), (false, 200)] {
        search(&mut model, is_up);
        let lines = picture(&mut model, SMALL);
        let texts = [row - 5, row + 5].map(|row| format!("row {row} "));
        expect(&lines, &[&format!("needle {row}"), &texts[0], &texts[1]]);
        assert!(styled(&mut model, SMALL, is_reversed).contains("needle"));
    }
    search(&mut model, false);
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["needle 200", "no later line has it"]);
    model.typed.reset();
    search(&mut model, true);
    expect(&picture(&mut model, SMALL), &["needle 200"]);
}

#[test]
fn a_line_of_a_terminal_that_says_error_is_red() {
    let mut model = model();
    model.windows.truncate(1);
    model.members[0].state = MemberState::Running;
    let long = "there is no motion that is called so ".repeat(3);
    let text = format!("\r\n> error: typed\r\nerror: {long}end\r\nfine\x1b[32m, green");
    model.hear(UiEvent::Output(WindowId(1), text.into_bytes()));
    let red = styled(&mut model, SMALL, |style| style.fg == Some(Color::Red));
    let begin = red.find("error: there").expect("an error");
    let red = &red[begin..];
    assert!(red.contains("called so end"), "{red}");
    assert!(!red.contains("typed") && !red.contains("fine"), "{red}");
}
