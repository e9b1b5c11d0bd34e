//! Choices that the user interface keeps.

use super::*;
use crate::ui::choices::{keep, restore};
use crate::ui::log::Level;

fn pane(model: &Model) -> Vec<Vec<String>> {
    model.plot.wish().panes
}

#[test]
fn choices_are_there_again() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("ui");
    let mut before = model();
    before.focus = Page::Window(WindowId(4));
    picture(&mut before, LARGE);
    before.focus = Page::Log;
    (before.zoomed, before.least) = (true, Level::Failure);
    before.plot.add_pane(vec!["index.*.position".into()]);
    before.plot.add_pane(vec!["*.tension".into()]);
    before.plot.fix_range((-1.0, 2.5));
    before.plot.zoom(1);
    before
        .plot
        .arm(Some("index.position>0.5~0.1".parse().unwrap()));
    keep(&before, &path).unwrap();

    let mut after = model();
    restore(&mut after, &path);
    assert_eq!(after.focus, Page::Log);
    assert_eq!(after.front, Page::Window(WindowId(4)));
    assert_eq!((after.zoomed, after.least), (true, Level::Failure));
    assert_eq!(pane(&after), pane(&before));
    assert_eq!(after.plot.state(), before.plot.state());
    assert_eq!(after.plot.panes[1].range, before.plot.panes[1].range);
    // The curves of the restored plots are fetched when they are first seen.
    (after.zoomed, after.focus) = (false, after.front);
    picture(&mut after, LARGE);
    assert!(after.begin_plots() && !after.plot.choose_first());
}

#[test]
fn without_a_file_nothing_is_chosen_or_said() {
    let place = tempfile::tempdir().unwrap();
    let mut model = model();
    restore(&mut model, &place.path().join("ui"));
    assert_eq!(model.focus, Page::Window(WindowId(1)));
    assert_eq!(model.own_line, None);
}

#[test]
fn a_window_that_is_not_there_any_more_is_not_in_front() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("ui");
    let mut before = model();
    let tool = before.open_window("debugger master".into(), 0, true);
    before.focus = Page::Window(tool);
    picture(&mut before, SMALL);
    keep(&before, &path).unwrap();
    let mut after = model();
    restore(&mut after, &path);
    let first = Page::Window(WindowId(1));
    assert_eq!((after.focus, after.front), (first, first));
}

#[test]
fn a_file_that_cannot_be_read_is_ignored_with_a_line_in_the_log() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("ui");
    let mut known = model();
    known.focus = Page::Files;
    keep(&known, &path).unwrap();
    let whole = std::fs::read_to_string(&path).unwrap();
    let newer = whole.replace("condor ui 1", "condor ui 2");
    let texts = [
        (newer.as_str(), "begins with `condor ui 2`"),
        ("", "begins with ``"),
        (&whole[..whole.len() / 2], "EOF while parsing"),
        (&whole.replace("alone", "lonely"), "unknown field `lonely`"),
        (&whole.replace("10000000000", "1"), "impossible ranges"),
    ];
    for (text, why) in texts {
        std::fs::write(&path, text).unwrap();
        let mut model = model();
        restore(&mut model, &path);
        assert_ne!(model.focus, Page::Files);
        model.hear(UiEvent::LogBegins(vec![
            "2026-11-21T15:28:52.078621Z a: b".into(),
        ]));
        model.focus = Page::Log;
        let lines = picture(&mut model, LARGE);
        let warning = "! ui: warning: layout and plots are not as they were:";
        expect(&lines, &["15:28:52.078 a: b", warning, why]);
    }
}
