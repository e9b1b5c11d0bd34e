//! What is typed faster than programs read it, and from scripts.

use std::io::Write;
use std::process::Stdio;
use std::thread;
use std::time::Instant;

use crate::running::{self, DEADLINE, Up};

/// Programs that write nothing once they have been told to stall.
const TWO: &str = r#"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["writer"]
    stall_seconds = 0
    [[processors]]
    number = 1
    name = "b"
    program = "THIS"
    arguments = ["writer"]
"#;

/// More than 64 KiB of lines.
const LINES: usize = 2000;

#[test]
fn what_waits_to_be_typed_is_bounded_and_its_writer_waits() {
    let up = Up::start(TWO, &[]);
    let (mut a, mut b) = (up.terminal("a"), up.terminal("b"));
    a.write_all(b"settled\rstall\r").unwrap();
    running::read_until(&mut a, "typed settled");
    let writer = thread::spawn(move || {
        for number in 0..LINES {
            let line = format!("line {number:05} of a text that somebody has pasted\r");
            a.write_all(line.as_bytes()).unwrap();
        }
        a
    });
    let typed = up.directory().terminals().join("a.typed");
    let length = || std::fs::metadata(&typed).unwrap().len();
    let begun = Instant::now();
    while length() < 64 * 1024 {
        assert!(begun.elapsed() < DEADLINE, "{} bytes", length());
        thread::yield_now();
    }
    // The service takes many turns meanwhile.
    for number in 0..100 {
        b.write_all(format!("turn {number:03}\r").as_bytes())
            .unwrap();
        running::read_until(&mut b, &format!("typed turn {number:03}"));
    }
    // What the stalled program has taken is no more than its terminal's queue holds.
    assert!(length() <= 68 * 1024, "{} bytes", length());
    running::kill(up.status().processors[0].pid.unwrap());
    let mut a = writer.join().unwrap();
    running::read_until(&mut a, &format!("typed line {:05}", LINES - 1));
    let log = up.directory().terminals().join("a.log");
    let text = std::fs::read_to_string(log).unwrap();
    let numbers = text.lines().filter_map(|it| it.strip_prefix("typed line "));
    let numbers: Vec<usize> = numbers.map(|it| it[..5].parse().unwrap()).collect();
    // The killed program has taken the first ones with it, which were in its own memory.
    assert!(numbers[0] < 200, "{}", numbers[0]);
    let all: Vec<usize> = (numbers[0]..LINES).collect();
    assert_eq!(numbers, all);
}

/// The number of files that a process has open.
fn open_files(process: u32) -> usize {
    std::fs::read_dir(format!("/proc/{process}/fd"))
        .unwrap()
        .count()
}

#[test]
fn who_types_at_a_full_terminal_is_forgotten_when_gone_and_has_its_turn() {
    let up = Up::start(TWO, &[]);
    let status = up.status();
    let service = status.services.iter().find(|it| it.name == "terminals");
    let service = service.unwrap().pid.unwrap();
    let (mut a, mut second) = (up.terminal("a"), up.terminal("a"));
    a.write_all(b"settled\rstall\r").unwrap();
    for viewer in [&mut a, &mut second] {
        running::read_until(viewer, "typed settled");
    }
    let open = open_files(service);
    let writer = thread::spawn(move || {
        for number in 0..LINES {
            a.write_all(format!("line {number:05} {}\r", "x".repeat(40)).as_bytes())
                .unwrap();
        }
        a
    });
    let typed = up.directory().terminals().join("a.typed");
    let wait_until = |happened: &dyn Fn() -> bool| {
        let begun = Instant::now();
        while !happened() {
            assert!(begun.elapsed() < DEADLINE, "{} files", open_files(service));
            thread::yield_now();
        }
    };
    wait_until(&|| std::fs::metadata(&typed).unwrap().len() >= 64 * 1024);
    second.write_all(b"\rmy turn\r").unwrap();
    // Each is there, and goes.
    for _ in 0..20 {
        up.read_terminal("a", "typed settled");
    }
    wait_until(&|| open_files(service) <= open);
    running::kill(status.processors[0].pid.unwrap());
    let log = up.directory().terminals().join("a.log");
    let text = || std::fs::read_to_string(&log).unwrap();
    let last = format!("line {:05}", LINES - 1);
    wait_until(&|| text().contains(&last));
    let text = text();
    assert!(text.find("my turn") < text.find(&last), "{text}");
    writer.join().unwrap();
}

#[test]
fn a_pipe_into_a_terminal_shows_the_answer() {
    let up = Up::start(TWO, &[]);
    up.read_terminal("a", "writer ");
    let mut child = up
        .command(&["tty", "a"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(b"ahoy\rstall\r")
        .unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(shown.contains("typed ahoy"), "{shown}");
}
