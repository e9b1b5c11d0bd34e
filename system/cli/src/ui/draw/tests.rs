use std::os::fd::OwnedFd;

use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;

use super::*;
use crate::counts::Row;
use crate::ui::Tool;
use crate::ui::feed::UiEvent;
use crate::ui::model::{FileServiceState, Popup};
use crate::ui::scroll::scroll;
use crate::ui::window::WindowId;
use condor_host::control::{ClockStatus, Member, SystemStatus};
use condor_host::error::me;
use condor_host::view::{LoopRates, Percentiles, VectorCounts};

mod choices;
mod log;
mod status;
mod tiles;

const SMALL: (u16, u16) = (80, 24);
const LARGE: (u16, u16) = (200, 50);
const NAMES: [&str; 5] = ["master", "servo-a", "servo-b", "table", "plant"];

fn member(number: u8, name: &str, state: MemberState) -> Member {
    Member {
        number,
        name: name.into(),
        kind: "process".into(),
        runs_here: true,
        program: "self".into(),
        arguments: Vec::new(),
        pid: Some(4000 + u32::from(number)),
        state,
        restarts: 0,
        last_exit: None,
    }
}

fn row<C: Clone>(processor: &str, counts: &C) -> Row<C> {
    Row {
        processor: processor.into(),
        counts: counts.clone(),
    }
}

fn model() -> Model {
    let processors = (0..5).zip(NAMES);
    let processors = processors.map(|(number, name)| member(number, name, MemberState::Running));
    let status = SystemStatus {
        system: "utah-mit-hand".into(),
        file: "hand.toml".into(),
        window_bytes: 4096,
        shared_memory: None,
        clock: None,
        files_root: Some("/srv/hand/files".into()),
        pid: 1,
        uptime: 12.0,
        services: vec![
            member(13, "files", MemberState::Running),
            member(14, "terminals", MemberState::Running),
        ],
        // The robot first, as in a description: windows go by number.
        processors: processors.rev().collect(),
    };
    let mut model = Model::new(&status, vec![Tool::debugger()]);
    for (id, name) in (1..).zip(NAMES) {
        let id = WindowId(id);
        let null = std::fs::File::options().write(true).open("/dev/null");
        model.hear(UiEvent::Opened(id, OwnedFd::from(null.unwrap()).into()));
        let text = format!("this is \x1b[1;31m{name}\x1b[0m\r\nready> ");
        model.hear(UiEvent::Output(id, text.into_bytes()));
    }
    let rates = LoopRates {
        name: "servo".into(),
        rate_hz: 400.0,
        reached_hz: Some(399.75),
        run_us: Some(123.4),
        worst_run_us: Some(2345.6),
        utilisation: Some(0.0494),
        worst_lateness_us: 98_765.4,
        lateness_percentiles_us: Percentiles::default(),
        run_percentiles_us: None,
        runs: 4000,
        overruns: 17,
        enabled: true,
        faulted: false,
        computed: false,
    };
    model.loops = NAMES.map(|name| row(name, &rates)).into();
    let vector = VectorCounts {
        vector: 40,
        name: "servos".into(),
        sent: 7,
        handled: 123_456,
        failed: 3,
        worst_us: 55.5,
    };
    model.vectors = NAMES.map(|name| row(name, &vector)).into();
    model.served = FileServiceState {
        messages: 815,
        per_second: Some(4.5),
    };
    model.hear(UiEvent::Log(
        "2026-11-21T15:28:52.078621Z servo-a: joined after 0.1 s".into(),
    ));
    model
}

/// The cells of a picture of this size.
fn cells(model: &mut Model, (columns, rows): (u16, u16)) -> Buffer {
    layout::resize(model, columns, rows);
    let mut terminal = Terminal::new(TestBackend::new(columns, rows)).unwrap();
    terminal.draw(|frame| draw(frame, model)).unwrap();
    terminal.backend().buffer().clone()
}

/// The lines of a picture of this size.
fn picture(model: &mut Model, (columns, rows): (u16, u16)) -> Vec<String> {
    let buffer = cells(model, (columns, rows));
    let line = |row| -> String {
        (0..columns)
            .map(|column| buffer[(column, row)].symbol())
            .collect()
    };
    (0..rows).map(line).collect()
}

fn expect(lines: &[String], texts: &[&str]) {
    for text in texts {
        let is_there = lines.iter().any(|line| line.contains(text));
        assert!(is_there, "no {text:?} in\n{}", lines.join("\n"));
    }
}

const LOOPS: [&str; 2] = [
    "processor loop   Hz reached run µs  worst use % late µs overruns",
    "servo-a   servo 400   399.8  123.4 2345.6  4.94 98765.4       17",
];
const MESSAGES: [&str; 2] = [
    "processor vector name   handled worst µs sent failed",
    "servo-b       40 servos  123456     55.5    7      3",
];
const FILES: [&str; 3] = [
    "serves    /srv/hand/files",
    "state     running, process 4013, 0 restarts",
    "requests  815, 4.5 a second",
];
const LOG: [&str; 1] = ["15:28:52.078 servo-a: joined after 0.1 s"];

#[test]
fn each_page_is_legible_on_a_small_terminal() {
    let mut model = model();
    let tabs = "1:master 2:servo-a 3:servo-b 4:table 5:plant Loops Messages Files Log";
    for (id, name) in (1..).zip(NAMES) {
        model.focus = Page::Window(WindowId(id));
        let lines = picture(&mut model, SMALL);
        let title = format!("{name}: running");
        let text = format!("this is {name}");
        expect(
            &lines,
            &[tabs, &title, &text, "ready>", "F1 help", "F10 leave"],
        );
    }
    // Programs write for 80 columns.
    let row = "0123456789".repeat(8);
    model.hear(UiEvent::Output(
        WindowId(5),
        format!("\r\n{row}").into_bytes(),
    ));
    expect(&picture(&mut model, SMALL), &[&row]);
    let tables: [(Page, &[&str]); 4] = [
        (Page::Loops, &LOOPS),
        (Page::Messages, &MESSAGES),
        (Page::Files, &FILES),
        (Page::Log, &LOG),
    ];
    for (page, texts) in tables {
        model.focus = page;
        expect(&picture(&mut model, SMALL), texts);
    }
}

#[test]
fn help_actions_and_the_way_out_fit_a_small_terminal() {
    let mut model = model();
    model.popup = Some(Popup::Help);
    let lines = picture(&mut model, SMALL);
    expect(
        &lines,
        &[
            "F2          actions: tools, the simulated clock; start,",
            "Any key closes",
        ],
    );
    model.popup = Some(Popup::Menu {
        member: 3,
        entry: 3,
    });
    let lines = picture(&mut model, SMALL);
    let debugger = format!("debugger: {} gdb 1", me());
    let seen = ["servo-a is running", &debugger, "restart", "stop", "load …"];
    expect(&lines, &seen);
    model.members[3].state = MemberState::Stopped;
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["servo-a is stopped", "start"]);
    assert!(!lines.iter().any(|line| line.contains("restart")));
    model.popup = Some(Popup::Confirm {
        member: 3,
        order: "stop",
    });
    let asks = ["y  stop `servo-a`; its program ends now", "Esc  keep it"];
    expect(&picture(&mut model, SMALL), &asks);
    model.popup = Some(Popup::Program { member: 3 });
    model.typed = "self servo".into();
    let lines = picture(&mut model, SMALL);
    expect(
        &lines,
        &["Type a program for servo-a", "self servo▏", "Esc: cancel"],
    );
    model.popup = Some(Popup::Leave);
    expect(
        &picture(&mut model, SMALL),
        &["d  stop the system and leave"],
    );
    model.hear(UiEvent::Gone("the supervisor ended".into()));
    expect(
        &picture(&mut model, SMALL),
        &["the system `utah-mit-hand` has ended"],
    );
}

#[test]
fn a_simulated_clock_is_seen_and_can_be_stopped() {
    let mut model = model();
    let mut clock = ClockStatus {
        seconds: 12.345,
        speed: None,
        factor: 5.5,
        overall: 4.4,
        paused: false,
        waits_for: "the real time".into(),
    };
    model.clock = Some(clock.clone());
    expect(
        &picture(&mut model, SMALL),
        &["utah-mit-hand 12.3 s, speed max (5.50 ×)  F1 help  F2 actions  F10 leave"],
    );
    let menu = Popup::Menu {
        member: 3,
        entry: 4,
    };
    model.popup = Some(menu);
    let entries = ["debugger:", "pause the clock", "step the clock …", "load …"];
    expect(&picture(&mut model, SMALL), &entries);
    (clock.paused, clock.speed) = (true, Some(0.5));
    model.clock = Some(clock);
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["resume the clock", "12.3 s, paused (5.50 ×)"]);
    model.popup = Some(Popup::Step);
    model.typed = "10ms".into();
    expect(
        &picture(&mut model, SMALL),
        &["Type how much time", "10ms▏"],
    );
}

#[test]
fn what_is_not_measured_in_simulated_time_is_not_shown() {
    let mut model = model();
    model.focus = Page::Loops;
    for row in &mut model.loops {
        let counts = &mut row.counts;
        (counts.run_us, counts.worst_run_us, counts.utilisation) = (None, None, None);
        counts.worst_lateness_us = 0.0;
    }
    let note = "loops take the time of `loop_times_us`; without it, none (-)";
    let row = "servo-a   servo 400   399.8      -     -     -       -       17";
    expect(&picture(&mut model, SMALL), &[row, note]);
}

#[test]
fn what_is_wrong_is_said() {
    let mut model = model();
    model.members[3].state = MemberState::Failed;
    model.hear(UiEvent::Closed(WindowId(2)));
    model.hear(UiEvent::Gone("the supervisor ended".into()));
    model.blind = Some("all numbers for visitors are taken".into());
    model.focus = Page::Window(WindowId(2));
    let lines = picture(&mut model, SMALL);
    expect(
        &lines,
        &[
            "servo-a: failed, no terminal",
            "No supervisor (F10 leaves): the supervisor ended",
        ],
    );
    model.focus = Page::Loops;
    let lines = picture(&mut model, SMALL);
    expect(
        &lines,
        &["The counts cannot be read: all numbers for visitors are taken"],
    );
}

#[test]
fn nothing_that_a_program_chose_commands_the_terminal() {
    let mut model = model();
    let hostile = "\u{1b}[2J\u{9b}2J\u{202e}\u{7}";
    model.vectors[0].counts.name = hostile.into();
    model.loops[0].counts.name = hostile.into();
    model.hear(UiEvent::Log(format!(
        "2026-11-21T15:28:52.078621Z a: {hostile}"
    )));
    model.hear(UiEvent::Output(WindowId(1), hostile.as_bytes().to_vec()));
    model.hear(UiEvent::Notice(hostile.into()));
    for size in [SMALL, LARGE] {
        for page in model.pages().collect::<Vec<_>>() {
            model.focus = page;
            let text = picture(&mut model, size).concat();
            let plain = condor_host::plain::plain(&text);
            assert!(matches!(plain, std::borrow::Cow::Borrowed(_)), "{plain}");
        }
    }
}

#[test]
fn only_what_a_program_writes_bold_is_bold() {
    let mut model = model();
    model.focus = Page::Window(WindowId(1));
    let text = b"plain \x1b[1mloud".to_vec();
    model.hear(UiEvent::Output(WindowId(1), text));
    let buffer = cells(&mut model, SMALL);
    let bold = buffer
        .content
        .iter()
        .filter(|cell| cell.modifier.contains(Modifier::BOLD));
    let bold: String = bold.map(ratatui::buffer::Cell::symbol).collect();
    assert!(bold.contains("loud") && !bold.contains("plain"), "{bold}");
}

#[test]
fn a_window_shows_what_it_has_shown_before() {
    let mut model = model();
    layout::resize(&mut model, SMALL.0, SMALL.1);
    let page = Page::Window(WindowId(1));
    let text = (0..100).map(|line| format!("\r\nline {line}"));
    let text = text.collect::<Vec<_>>().concat();
    model.hear(UiEvent::Output(WindowId(1), text.into_bytes()));
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["line 99"]);
    scroll(&mut model, page, 30);
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["line 69", "30 lines back"]);
    assert!(!lines.join("\n").contains("line 99"));
    scroll(&mut model, page, -40);
    expect(&picture(&mut model, SMALL), &["line 99"]);
}

#[test]
fn what_was_written_is_whole_again_on_a_wider_screen() {
    let mut model = model();
    let row = "0123456789".repeat(11);
    let text = format!("\r\n{row}\r\nand more");
    model.hear(UiEvent::Output(WindowId(2), text.into_bytes()));
    model.focus = Page::Window(WindowId(2));
    expect(&picture(&mut model, (44, 24)), &[&row[..44]]);
    expect(&picture(&mut model, (120, 24)), &[&row, "and more"]);
}

#[test]
fn a_line_of_the_log_is_not_cut() {
    let mut model = model();
    let words = "a line that is longer than a small terminal is wide ".repeat(2);
    model.hear(UiEvent::Log(format!(
        "2026-11-21T15:28:53.000000Z condor: {words}end"
    )));
    model.focus = Page::Log;
    let lines = picture(&mut model, SMALL);
    expect(&lines, &["15:28:53.000 condor: a line", "wide end"]);
    for number in 0..100 {
        model.hear(UiEvent::Log(format!(
            "2026-11-21T15:28:54.000000Z number {number}"
        )));
    }
    // Its beginning can be reached, and no further.
    picture(&mut model, SMALL);
    scroll(&mut model, Page::Log, 1000);
    expect(&picture(&mut model, SMALL), &["15:28:52.078"]);
    scroll(&mut model, Page::Log, -1);
    expect(&picture(&mut model, SMALL), &["15:28:53.000"]);
}

#[test]
fn the_titles_of_a_table_stay() {
    let mut model = model();
    let vectors = model.vectors.clone();
    for _ in 0..10 {
        model.vectors.extend(vectors.clone());
    }
    model.vectors[54].processor = "the-last".into();
    model.focus = Page::Messages;
    picture(&mut model, SMALL);
    scroll(&mut model, Page::Messages, -1000);
    let lines = picture(&mut model, SMALL);
    expect(&lines, &[MESSAGES[0], "the-last"]);
    // Rows fill the page: 22 lines less two borders and the titles.
    let rows = lines.iter().filter(|line| line.contains("servos"));
    assert_eq!(rows.count(), 19);
}

#[test]
fn a_service_that_comes_again_repeats_nothing_on_the_screen() {
    let mut model = model();
    model.hear(UiEvent::Closed(WindowId(1)));
    let window = model.window_mut(WindowId(1)).unwrap();
    assert!(!window.type_in(b"typed meanwhile"));
    let (mut service, input) = std::os::unix::net::UnixStream::pair().unwrap();
    model.hear(UiEvent::Opened(WindowId(1), OwnedFd::from(input).into()));
    let mut typed = [0; 15];
    std::io::Read::read_exact(&mut service, &mut typed).unwrap();
    assert_eq!(&typed, b"typed meanwhile");
    model.hear(UiEvent::Output(
        WindowId(1),
        b"this is master\r\nready> ".into(),
    ));
    let lines = picture(&mut model, SMALL);
    let count = lines.iter().filter(|line| line.contains("this is master"));
    assert_eq!(count.count(), 1, "{lines:?}");
}

#[test]
fn pages_follow_each_other_in_the_order_of_their_names() {
    let mut model = model();
    model.step(-1);
    assert_eq!(model.focus, Page::Plots);
    model.step(2);
    assert_eq!(model.focus, Page::Window(WindowId(2)));
    let id = model.open_window("debugger servo-a".into(), 1, true);
    model.focus = Page::Window(id);
    model.forget(id);
    assert_eq!(model.focus, Page::Window(WindowId(5)));
}
