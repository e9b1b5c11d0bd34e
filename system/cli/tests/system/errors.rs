//! Errors of the command line, provoked: each has the user's name of the thing, and a remedy. The table is the
//! file `errors.md`.

use std::fmt::Write as _;
use std::net::TcpListener;
use std::process::Stdio;

use condor_host::view::View;
use condor_mbox::Processor;

use crate::joint::{TWO, start};
use crate::running::Up;

const ERRORS: &str = include_str!("errors.md");

/// The rows of a state: command, exit status, name and remedy.
fn rows(state: &str) -> impl Iterator<Item = [&'static str; 4]> {
    let mut sections = ERRORS.split("\n## ").map(|it| it.split_once('\n').unwrap());
    let section = sections.find(|(title, _)| *title == state);
    let (_, table) = section.unwrap_or_else(|| panic!("no {state:?}"));
    // Below the titles and the line under them.
    let lines = table.lines().filter(|line| line.starts_with("| ")).skip(1);
    lines.map(|line| {
        let cells: Vec<_> = line.trim_matches('|').split('|').map(str::trim).collect();
        cells.try_into().unwrap()
    })
}

/// Runs the commands of a state; the answers that lack something are told together.
fn provoke(up: &Up, state: &str, port: u16) {
    let port = port.to_string();
    let mut wrong = String::new();
    for [line, status, name, remedy] in rows(state) {
        let line = line.replace("TAKEN", &port);
        let words: Vec<_> = line.split_whitespace().collect();
        let mut command = up.command(&words);
        command.current_dir(up.path(".")).stdin(Stdio::null());
        let output = command.output().unwrap();
        let told = [output.stderr, output.stdout].concat();
        let told = String::from_utf8(told).unwrap();
        let code = output.status.code().unwrap_or_default().to_string();
        let name = name.replace("TAKEN", &port);
        if code != status || !told.contains(&name) || !told.contains(remedy) {
            writeln!(
                wrong,
                "{line}: {code}, {told}lacks: {status}, {name} | {remedy}"
            )
            .unwrap();
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn errors_without_a_system_name_the_thing_and_a_remedy() {
    let up = Up::start(TWO, &[]);
    up.run(&["down"]);
    std::fs::write(up.path("text.mcap"), "text").unwrap();
    provoke(&up, "without a system", 0);
}

#[test]
fn errors_of_a_running_system_name_the_thing_and_a_remedy() {
    let up = start(&[]);
    std::fs::write(up.path("text.mcap"), "text").unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let stiffness = || up.run(&["vars", "get", "b:joint.stiffness"]).stdout;
    let before = stiffness();
    provoke(&up, "with two joints", port);
    assert_eq!(stiffness(), before);
    up.run(&["stop", "b"]);
    provoke(&up, "with a stopped program", port);
    let view = View::open(&up.directory(), 65536).unwrap();
    view.region(Processor(1)).unwrap().set_word(4, 9).unwrap();
    provoke(&up, "with an object table of another version", port);
}

#[test]
fn errors_of_a_paused_clock_name_the_thing_and_a_remedy() {
    let up = Up::start(TWO, &["--clock", "simulated"]);
    up.run(&["clock", "pause"]);
    let running = up.processes();
    provoke(&up, "with a paused clock", 0);
    assert_eq!(up.processes(), running);
    up.run(&["clock", "resume"]);
}
