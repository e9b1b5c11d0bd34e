//! Pages side by side on large screens.

use crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use super::*;
use crate::plot::{FeedEvent, Figure};
use condor_host::robot::{Frame, Robot, RobotJoint, RobotLine};

const MEDIUM: (u16, u16) = (120, 36);

fn expect_none(lines: &[String], texts: &[&str]) {
    let all = lines.join("\n");
    for text in texts {
        assert!(!all.contains(text), "{text:?} in\n{all}");
    }
}

#[test]
fn plots_the_page_in_front_and_the_log_are_seen_at_once_from_120_columns_on() {
    let mut model = model();
    let others = ["Plots: 10 s, F1 keys", "┌ Log ", "15:28:52.078 servo-a:"];
    let lines = picture(&mut model, MEDIUM);
    expect(&lines, &others);
    expect(&lines, &["master: running", "this is master"]);
    expect_none(&lines, &["Servo loops", "this is servo-a"]);
    // A table is there in the place of the window, which comes again.
    model.focus = Page::Loops;
    let lines = picture(&mut model, MEDIUM);
    expect(&lines, &others);
    expect(&lines, &LOOPS);
    expect_none(&lines, &["this is master"]);
    for page in [Page::Log, Page::Plots] {
        model.focus = page;
        expect(&picture(&mut model, MEDIUM), &["this is master"]);
    }
    model.focus = Page::Window(WindowId(2));
    model.zoomed = true;
    let lines = picture(&mut model, MEDIUM);
    expect(&lines, &["this is servo-a"]);
    expect_none(&lines, &others);
    model.zoomed = false;
    for size in [(119, 36), (120, 35)] {
        expect_none(&picture(&mut model, size), &others);
    }
}

#[test]
fn all_tables_are_seen_at_once_on_a_large_terminal() {
    let mut model = model();
    let lines = picture(&mut model, LARGE);
    expect(&lines, &["Plots: 10 s", "this is master"]);
    for texts in [&LOOPS[..], &MESSAGES, &FILES, &LOG] {
        expect(&lines, texts);
    }
    model.focus = Page::Window(WindowId(3));
    expect(&picture(&mut model, LARGE), &["this is servo-b"]);
    model.focus = Page::Messages;
    expect(&picture(&mut model, LARGE), &["this is servo-b"]);
    model.zoomed = true;
    let lines = picture(&mut model, LARGE);
    expect(&lines, &MESSAGES);
    expect_none(&lines, &["this is servo-b", "Servo loops"]);
}

#[test]
fn a_window_has_its_80_columns_beside_others() {
    let mut model = model();
    let row = "0123456789".repeat(8);
    let text = format!("\r\n{row}").into_bytes();
    model.hear(UiEvent::Output(WindowId(1), text));
    for size in [MEDIUM, (166, 40), LARGE] {
        expect(&picture(&mut model, size), &[&row]);
    }
}

#[test]
fn plots_are_alone_on_a_small_terminal() {
    let mut model = model();
    model.focus = Page::Plots;
    let lines = picture(&mut model, SMALL);
    let seen = [
        "Plots: 10 s, F1 keys",
        "no variables: n chooses some",
        "0 s",
    ];
    expect(&lines, &seen);
    expect_none(&lines, &["this is"]);
    model.hear(UiEvent::Plot(FeedEvent::Trouble("it has ended".into())));
    expect(&picture(&mut model, SMALL), &["it has ended"]);
}

#[test]
fn plots_begin_when_they_are_first_seen() {
    let samples = UiEvent::Plot(FeedEvent::Samples(Vec::new()));
    let mut model = model();
    picture(&mut model, SMALL);
    assert!(!model.is_seen(&samples) && !model.begin_plots());
    picture(&mut model, MEDIUM);
    assert!(model.is_seen(&samples) && model.begin_plots());
    assert!(!model.begin_plots());
    picture(&mut model, SMALL);
    assert!(!model.is_seen(&samples));
    model.focus = Page::Plots;
    assert!(model.is_seen(&samples));
}

/// A robot of one part.
struct Arm;

impl Robot for Arm {
    fn joints(&self) -> &[RobotJoint] {
        &[]
    }

    fn lines(&self, _: &[f64]) -> Vec<RobotLine> {
        vec![RobotLine {
            name: "forearm".into(),
            radius_m: 0.0,
            points: vec![[0.0; 3], [0.0, 0.2, 0.0]],
            effort: None,
        }]
    }

    fn frames(&self, _: &[f64]) -> Vec<Frame> {
        Vec::new()
    }

    fn urdf(&self) -> Option<String> {
        None
    }
}

#[test]
fn the_robot_is_beside_the_plots() {
    for size in [MEDIUM, LARGE] {
        let mut model = model();
        model.plot.figure = Some(Figure::new(Box::new(Arm)));
        picture(&mut model, size);
        assert!(model.begin_plots());
        let lines = picture(&mut model, size);
        expect(&lines, &["forearm", "no variables: n chooses some"]);
        expect(&lines, &["this is master", "15:28:52.078 servo-a:"]);
    }
}

#[test]
fn the_help_of_plots_is_in_front_of_all() {
    let mut model = model();
    model.focus = Page::Plots;
    let help = KeyEvent::new(KeyCode::F(1), KeyModifiers::NONE);
    crate::plot::press(&mut model.plot, &help);
    for size in [MEDIUM, LARGE] {
        let lines = picture(&mut model, size);
        expect(&lines, &["n  p  x ", "Any key closes this help."]);
    }
}
