use core::time::Duration;

use crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::style::Color;

use super::*;
use crate::plot::curve::{ChosenCurves, Sample, Variable, Wish};
use crate::plot::figure::Figure;
use crate::plot::keys::{PlotRequest, press};
use condor_host::robot::{Frame, Robot, RobotJoint, RobotLine};

const SMALL: (u16, u16) = (80, 22);
const LARGE: (u16, u16) = (200, 48);
const MS: u64 = 1_000_000;

/// An arm of one joint with a tendon.
struct Arm {
    joints: [RobotJoint; 1],
}

impl Arm {
    fn new() -> Self {
        let joint = RobotJoint {
            name: "elbow".into(),
            position: "elbow.position".into(),
            velocity: None,
            effort: None,
            limits: [0.0, 1.5],
        };
        Self { joints: [joint] }
    }
}

impl Robot for Arm {
    fn joints(&self) -> &[RobotJoint] {
        &self.joints
    }

    fn lines(&self, positions: &[f64]) -> Vec<RobotLine> {
        let (s, c) = positions.first().copied().unwrap_or(0.0).sin_cos();
        let bone = RobotLine {
            name: "arm".into(),
            radius_m: 0.0,
            points: vec![[0.0; 3], [0.0, 0.2, 0.0], [0.0, 0.2 + 0.2 * c, 0.2 * s]],
            effort: None,
        };
        let tendon = RobotLine {
            name: "biceps".into(),
            radius_m: 0.0,
            points: vec![[0.0, 0.0, 0.1], [0.0, 0.2, 0.1]],
            effort: Some("elbow.tension".into()),
        };
        vec![bone, tendon]
    }

    fn frames(&self, _: &[f64]) -> Vec<Frame> {
        Vec::new()
    }

    fn urdf(&self) -> Option<String> {
        None
    }
}

fn variable(name: &str, unit: &str) -> Variable {
    Variable {
        processor: "servo-a".into(),
        owner: "servo".into(),
        name: name.into(),
        unit: unit.into(),
        labels: Vec::new(),
    }
}

fn plot() -> Plot {
    let figure = Figure::new(Box::new(Arm::new()));
    let mut plot = Plot::new(Duration::from_secs(1), Some(figure), true);
    plot.add_pane(vec!["elbow.position".into(), "elbow.target".into()]);
    plot.add_pane(vec!["elbow.tension".into()]);
    let mode = Variable {
        labels: vec!["idle".into(), "hold".into()],
        ..variable("mode", "")
    };
    plot.choose(ChosenCurves {
        variables: vec![
            variable("elbow.position", "rad"),
            variable("elbow.target", "rad"),
            variable("elbow.tension", "N"),
            mode,
        ],
        panes: vec![vec![0, 1], vec![2, 3]],
        known: ["elbow.position", "elbow.target", "elbow.tension", "mode"]
            .map(String::from)
            .into(),
    });
    plot
}

/// Two seconds of a ramp from 0 to 2, of its target, of a tension, and of a mode; at 400 Hz.
fn ramp(plot: &mut Plot) {
    for tick in 0..=800_u32 {
        let at_ns = u64::from(tick) * 5 * MS / 2;
        let value = f64::from(tick) / 400.0;
        let samples = [value, 1.25, 20.0 + 20.0 * value, 1.0];
        let samples = samples.iter().enumerate();
        let samples: Vec<_> = samples
            .map(|(curve, &value)| Sample {
                curve,
                at_ns,
                value,
            })
            .collect();
        plot.take(&samples);
    }
}

fn buffer(plot: &Plot, (columns, rows): (u16, u16)) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(columns, rows)).unwrap();
    let drawn = terminal.draw(|frame| draw(plot, frame.area(), frame.buffer_mut()));
    drawn.unwrap().buffer.clone()
}

fn picture(plot: &Plot, size: (u16, u16)) -> Vec<String> {
    let buffer = buffer(plot, size);
    let line = |row| {
        (0..size.0)
            .map(|column| buffer[(column, row)].symbol())
            .collect()
    };
    (0..size.1).map(line).collect()
}

fn expect(lines: &[String], texts: &[&str]) {
    for text in texts {
        let is_there = lines.iter().any(|line| line.contains(text));
        assert!(is_there, "no {text:?} in\n{}", lines.join("\n"));
    }
}

fn key(plot: &mut Plot, code: KeyCode) -> Option<PlotRequest> {
    press(plot, &KeyEvent::new(code, KeyModifiers::NONE))
}

fn typed(plot: &mut Plot, text: &str) -> Option<PlotRequest> {
    for letter in text.chars() {
        key(plot, KeyCode::Char(letter));
    }
    key(plot, KeyCode::Enter)
}

/// Returns the rows, from the top, that have braille dots in a column.
fn dotted(lines: &[String], column: usize) -> Vec<usize> {
    let dots = '\u{2801}'..='\u{28ff}';
    let rows = lines.iter().enumerate();
    let rows = rows.filter(|(_, line)| {
        line.chars()
            .nth(column)
            .is_some_and(|it| dots.contains(&it))
    });
    rows.map(|(row, _)| row).collect()
}

#[test]
fn panes_have_legends_axes_and_curves_at_both_sizes() {
    for size in [SMALL, LARGE] {
        let mut plot = plot();
        ramp(&mut plot);
        let lines = picture(&plot, size);
        let legend = "a elbow.position  2.000 rad  b elbow.target  1.250 rad";
        expect(&lines, &[legend, "c elbow.tension  60.00 N  d mode hold"]);
        // The ramp from 1 to 2 ends at the top right, and begins at the bottom left.
        let (left, right) = (usize::from(AXIS), usize::from(size.0) - 1);
        let first = *dotted(&lines, left)
            .iter()
            .filter(|row| **row < lines.len() / 2)
            .max()
            .unwrap();
        let last = dotted(&lines, right)[0];
        assert!(
            last < 3 && first > lines.len() / 2 - 4,
            "{first} {last}\n{}",
            lines.join("\n")
        );
        expect(&lines, &["1.0 ┤", "2.0 ┤", "0 s"]);
        let axis = lines.last().unwrap();
        assert!(
            axis.contains("-0.5") && axis.trim_end().ends_with("0 s"),
            "{axis}"
        );
    }
}

#[test]
fn it_begins_with_positions_unless_somebody_has_chosen() {
    let known = || {
        ["a.ticks", "a.position", "b.position"]
            .map(String::from)
            .to_vec()
    };
    let names = |known| {
        let mut plot = Plot::new(Duration::from_secs(1), None, true);
        assert!(plot.begin(true) && !plot.begin(true));
        assert!(!plot.choose_first());
        plot.known = known;
        assert!(plot.choose_first() && !plot.choose_first());
        plot.wish().panes
    };
    assert_eq!(names(known()), [["a.position", "b.position"]]);
    assert_eq!(names(vec!["beats".into()]), [["beats"]]);
    let mut chosen = plot();
    assert!(chosen.begin(true) && chosen.place == RobotPane::Hidden);
    chosen.known = known();
    assert!(!chosen.choose_first());
}

#[test]
fn the_time_of_a_recording_begins_at_zero() {
    let mut plot = plot();
    ramp(&mut plot);
    plot.zero_ns = Some(1000 * MS);
    let lines = picture(&plot, SMALL);
    let axis = lines.last().unwrap();
    assert!(
        axis.contains(" 0.5 ") && axis.trim_end().ends_with(" 1.0 s"),
        "{axis}"
    );
}

#[test]
fn curves_have_letters_and_colours() {
    let mut plot = plot();
    ramp(&mut plot);
    let buffer = buffer(&plot, SMALL);
    let of = |letter: &str, color| {
        let mut cells = buffer.content.iter().skip(usize::from(SMALL.0));
        cells.any(|cell| cell.symbol() == letter && cell.fg == color)
    };
    assert!(of("a", Color::Cyan) && of("b", Color::Yellow));
    let dots = buffer
        .content
        .iter()
        .filter(|cell| cell.symbol() > "\u{2800}");
    let dots: Vec<Color> = dots.map(|cell| cell.fg).collect();
    assert!(dots.contains(&Color::Cyan) && dots.contains(&Color::Yellow));
}

#[test]
fn what_is_not_known_is_a_gap() {
    let mut plot = plot();
    ramp(&mut plot);
    let solid = picture(&plot, SMALL);
    let column = usize::from(AXIS) + 35;
    assert!(!dotted(&solid, column).is_empty());
    // Half of the time is lost, from 2 s on.
    for (at_ns, value) in [(2000 * MS, f64::NAN), (2450 * MS, 2.0), (2500 * MS, 2.0)] {
        let samples = [0, 1, 2, 3].map(|curve| Sample {
            curve,
            at_ns,
            value,
        });
        plot.take(&samples);
    }
    let lines = picture(&plot, SMALL);
    for column in [40, 45, 60].map(|it| usize::from(AXIS) + it) {
        assert!(dotted(&lines, column).is_empty(), "{}", lines.join("\n"));
    }
    assert!(!dotted(&lines, 79).is_empty(), "{}", lines.join("\n"));
}

#[test]
fn the_cursor_tells_the_values_of_its_instant() {
    let mut plot = plot();
    ramp(&mut plot);
    key(&mut plot, KeyCode::Char('c'));
    expect(&picture(&plot, SMALL), &["a elbow.position  1.500 rad"]);
    for _ in 0..20 {
        key(&mut plot, KeyCode::Left);
    }
    let lines = picture(&plot, SMALL);
    expect(&lines, &["a elbow.position  1.400 rad", "│-0.600 s"]);
    // What comes does not move it.
    plot.take(&[Sample {
        curve: 0,
        at_ns: 2500 * MS,
        value: 9.0,
    }]);
    expect(&picture(&plot, SMALL), &["a elbow.position  1.400 rad"]);
    // Far to the left, what is seen follows.
    for _ in 0..200 {
        key(&mut plot, KeyCode::Left);
    }
    expect(&picture(&plot, SMALL), &["a elbow.position  0.400 rad"]);
    key(&mut plot, KeyCode::End);
    expect(&picture(&plot, SMALL), &["a elbow.position  9.000 rad"]);
}

#[test]
fn time_is_zoomed_panned_and_stopped() {
    let mut plot = plot();
    ramp(&mut plot);
    key(&mut plot, KeyCode::Char('+'));
    assert_eq!(plot.state(), "500 ms");
    expect(&picture(&plot, SMALL), &["-400", "-200", "0 ms"]);
    key(&mut plot, KeyCode::Char('-'));
    key(&mut plot, KeyCode::Char('-'));
    assert_eq!(plot.state(), "2 s");
    key(&mut plot, KeyCode::Left);
    assert_eq!(plot.state(), "2 s, paused");
    // A quarter of a second back.
    expect(&picture(&plot, SMALL), &["a elbow.position  1.750 rad"]);
    key(&mut plot, KeyCode::Right);
    assert_eq!(plot.state(), "2 s");
    key(&mut plot, KeyCode::Char(' '));
    plot.take(&[Sample {
        curve: 0,
        at_ns: 2500 * MS,
        value: 9.0,
    }]);
    expect(&picture(&plot, SMALL), &["a elbow.position  2.000 rad"]);
    key(&mut plot, KeyCode::Char(' '));
    expect(&picture(&plot, SMALL), &["a elbow.position  9.000 rad"]);
}

#[test]
fn a_range_of_values_is_fixed_moved_and_stretched() {
    let mut plot = plot();
    ramp(&mut plot);
    plot.step_pane(1);
    key(&mut plot, KeyCode::Char('y'));
    plot.take(&[Sample {
        curve: 0,
        at_ns: 2010 * MS,
        value: 1000.0,
    }]);
    expect(&picture(&plot, SMALL), &["1.0 ┤", "2.0 ┤"]);
    for _ in 0..8 {
        key(&mut plot, KeyCode::Up);
    }
    expect(&picture(&plot, SMALL), &["2.5 ┤"]);
    for _ in 0..4 {
        key(&mut plot, KeyCode::Char(']'));
    }
    expect(&picture(&plot, SMALL), &["2 ┤", "3 ┤"]);
    key(&mut plot, KeyCode::Char('y'));
    expect(&picture(&plot, SMALL), &["1000 ┤"]);
}

#[test]
fn a_trigger_stops_what_is_seen_at_its_instant() {
    let mut plot = plot();
    key(&mut plot, KeyCode::Char('t'));
    assert_eq!(
        typed(&mut plot, "elbow.position>1"),
        Some(PlotRequest::Fetch)
    );
    assert!(plot.wish().besides.contains(&"elbow.position".to_owned()));
    assert_eq!(plot.state(), "1 s, trigger elbow.position>1: waits");
    ramp(&mut plot);
    assert_eq!(plot.state(), "1 s, trigger elbow.position>1: at 0");
    // It passed 1 in the tick after 1 s: three quarters of the time are after that.
    expect(&picture(&plot, SMALL), &["a elbow.position  1.752 rad"]);
    let lines = picture(&plot, SMALL);
    let axis = lines.last().unwrap();
    let zero = axis.find("0 s").unwrap();
    assert!((25..30).contains(&zero), "{axis}");
    expect(&lines, &["╎", "╌"]);
    key(&mut plot, KeyCode::Char('t'));
    key(&mut plot, KeyCode::Esc);
    key(&mut plot, KeyCode::Char('t'));
    assert_eq!(typed(&mut plot, "x"), None);
    expect(
        &picture(&plot, SMALL),
        &["`elbow.position>1x` is not a trigger such as"],
    );
}

#[test]
fn names_are_typed_and_completed() {
    let mut plot = plot();
    key(&mut plot, KeyCode::Char('p'));
    for letter in "mode el".chars() {
        key(&mut plot, KeyCode::Char(letter));
    }
    expect(&picture(&plot, SMALL), &["mode el▏", "  elbow.tension"]);
    key(&mut plot, KeyCode::Tab);
    key(&mut plot, KeyCode::Char('p'));
    key(&mut plot, KeyCode::Tab);
    assert_eq!(key(&mut plot, KeyCode::Enter), Some(PlotRequest::Fetch));
    let expected = Wish {
        panes: [
            &["elbow.position", "elbow.target"][..],
            &["elbow.tension"],
            &["mode", "elbow.position"],
        ]
        .map(|names| names.iter().map(|&name| name.to_owned()).collect())
        .into(),
        besides: Vec::new(),
    };
    assert_eq!(plot.wish(), expected);
    assert_eq!(key(&mut plot, KeyCode::Char('x')), Some(PlotRequest::Fetch));
    assert_eq!(plot.wish().panes, expected.panes[..2]);
}

#[test]
fn what_is_typed_can_be_changed_by_the_usual_keys() {
    let mut plot = plot();
    let control = |plot: &mut Plot, letter| {
        let key = KeyEvent::new(KeyCode::Char(letter), KeyModifiers::CONTROL);
        assert_eq!(press(plot, &key), None);
    };
    key(&mut plot, KeyCode::Char('n'));
    for letter in "mode".chars() {
        key(&mut plot, KeyCode::Char(letter));
    }
    expect(&picture(&plot, SMALL), &["║ elbow.tension mode▏"]);
    control(&mut plot, 'w');
    control(&mut plot, 'a');
    key(&mut plot, KeyCode::Char('*'));
    expect(&picture(&plot, SMALL), &["║ *▏elbow.tension "]);
    control(&mut plot, 'e');
    key(&mut plot, KeyCode::Char('x'));
    expect(&picture(&plot, SMALL), &["║ *elbow.tension x▏"]);
    control(&mut plot, 'u');
    expect(&picture(&plot, SMALL), &["║ ▏"]);
}

#[test]
fn help_fits_a_small_terminal() {
    let mut plot = plot();
    key(&mut plot, KeyCode::F(1));
    expect(
        &picture(&plot, SMALL),
        &[
            "zoom in time",
            "turn the robot",
            "Any key closes this help.",
        ],
    );
    key(&mut plot, KeyCode::Char('q'));
    assert_eq!(key(&mut plot, KeyCode::Char('q')), Some(PlotRequest::Leave));
}

#[test]
fn the_robot_is_seen_with_its_tensions() {
    for size in [SMALL, LARGE] {
        let mut plot = plot();
        assert_eq!(key(&mut plot, KeyCode::Char('r')), Some(PlotRequest::Fetch));
        assert_eq!(plot.wish().besides, ["elbow.position", "elbow.tension"]);
        ramp(&mut plot);
        let lines = picture(&plot, size);
        expect(
            &lines,
            &["a elbow.position", "arm", "tendons 20.00", "60.00 N"],
        );
        let colors = |plot: &Plot| -> Vec<Color> {
            buffer(plot, size)
                .content
                .iter()
                .map(|cell| cell.fg)
                .collect()
        };
        assert!(colors(&plot).contains(&Color::Red));
        // A weak tendon has another colour.
        key(&mut plot, KeyCode::Char('r'));
        plot.take(&[Sample {
            curve: 2,
            at_ns: 2000 * MS,
            value: 1.0,
        }]);
        // What is left of the strongest colour is its mark in the legend.
        let colors = colors(&plot).into_iter();
        assert_eq!(colors.filter(|color| *color == Color::Red).count(), 2);
    }
}

#[test]
fn the_robot_moves_with_its_joints_and_can_be_turned() {
    let mut plot = plot();
    plot.place = RobotPane::Alone;
    plot.choose(ChosenCurves {
        variables: vec![variable("elbow.position", "rad")],
        ..ChosenCurves::default()
    });
    plot.take(&[Sample {
        curve: 0,
        at_ns: MS,
        value: 0.0,
    }]);
    let straight = picture(&plot, SMALL);
    plot.take(&[Sample {
        curve: 0,
        at_ns: 2 * MS,
        value: 1.5,
    }]);
    let bent = picture(&plot, SMALL);
    assert_ne!(straight, bent);
    let row = |lines: &[String]| lines.iter().position(|line| line.contains("arm")).unwrap();
    assert!(row(&bent) < row(&straight), "{}", bent.join("\n"));
    for letter in "aw".chars() {
        let before = picture(&plot, SMALL);
        key(&mut plot, KeyCode::Char(letter));
        assert_ne!(picture(&plot, SMALL), before);
    }
    let turned = picture(&plot, SMALL);
    for letter in "ds".chars() {
        key(&mut plot, KeyCode::Char(letter));
    }
    assert_ne!(picture(&plot, SMALL), turned);
    assert_eq!(picture(&plot, SMALL), bent);
}

#[test]
fn without_colours_tensions_are_digits() {
    let mut plot = plot();
    (plot.place, plot.has_colors) = (RobotPane::Alone, false);
    plot.choose(ChosenCurves {
        variables: vec![
            variable("elbow.tension", "N"),
            variable("elbow.position", "rad"),
        ],
        ..ChosenCurves::default()
    });
    plot.take(&[Sample {
        curve: 0,
        at_ns: MS,
        value: 50.0,
    }]);
    plot.take(&[Sample {
        curve: 0,
        at_ns: 2 * MS,
        value: 25.0,
    }]);
    plot.take(&[Sample {
        curve: 0,
        at_ns: 3 * MS,
        value: 37.0,
    }]);
    let lines = picture(&plot, SMALL);
    expect(&lines, &["tendons: 0 is 25.00 N, 9 is 50.00 N"]);
    let (_, picture) = lines.split_last().unwrap();
    assert!(
        picture.iter().any(|line| line.contains('4')),
        "{}",
        picture.join("\n")
    );
}

#[test]
fn curves_that_stay_keep_their_values() {
    let mut plot = plot();
    ramp(&mut plot);
    let variables = vec![variable("elbow.tension", "N"), variable("new", "")];
    plot.choose(ChosenCurves {
        variables,
        panes: vec![vec![1], vec![0]],
        known: Vec::new(),
    });
    let kept = plot.history(0).unwrap();
    assert_eq!(kept.at(1000 * MS), Some((40.0, 40.0)));
    // Nobody has fetched it meanwhile.
    assert_eq!(kept.at(2000 * MS), None);
    assert_eq!(plot.history(1).unwrap().newest_ns(), None);
}

#[test]
fn nothing_that_a_program_chose_commands_the_terminal() {
    let hostile = "\u{1b}[2J\u{202e}\u{7}";
    let mut plot = plot();
    plot.choose(ChosenCurves {
        variables: vec![variable(hostile, hostile)],
        panes: vec![vec![0], vec![0]],
        known: vec![hostile.into()],
    });
    plot.take(&[Sample {
        curve: 0,
        at_ns: u64::MAX,
        value: f64::MAX,
    }]);
    plot.take(&[Sample {
        curve: 0,
        at_ns: u64::MAX,
        value: f64::MIN,
    }]);
    key(&mut plot, KeyCode::Char('p'));
    key(&mut plot, KeyCode::Char('2'));
    for size in [SMALL, LARGE, (3, 2), (0, 0)] {
        let text = picture(&plot, size).concat();
        assert_eq!(condor_host::plain::plain(&text), text);
    }
}
