//! What a program, a service or a full disk does to the others: nothing without end.

use condor_host::control::MemberState;

use crate::running::{self, Up, kill};
use crate::supervisor::TWO;

#[test]
fn a_program_that_prints_without_end_holds_nobody_up() {
    let up = Up::launch(&TWO.replacen("writer", "printer", 1), &[], |_| {});
    up.wait_until_started();
    let left_out = up.wait_until_told("lines were left out");
    assert!(left_out.contains(" a: "), "{left_out}");
    let log = up.directory().log();
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.contains("\\u{1b}[2Jand on and on\n"), "{text}");
    assert!(!text.contains('\x1b'), "{text}");
    up.read_terminal("b", &format!("writer {}\r\n", up.lines("b") + 50));
    up.interrupt();
    assert_eq!(up.end().0, Some(0));
}

#[test]
fn a_service_that_never_serves_is_given_up_and_the_system_does_not_come_up() {
    let text = format!("[services]\nrestarts = 2\n{TWO}");
    let up = Up::launch(&text, &[], |place| {
        // Where the file service keeps what is its own.
        std::fs::create_dir(place.join("files")).unwrap();
        std::fs::write(place.join("files/.condor-fs"), "no directory").unwrap();
    });
    let (code, summary, told) = up.end_telling();
    assert_eq!(code, Some(1), "{told}");
    let given_up = "not started again after 2 restarts without joining";
    assert!(told.contains(given_up), "{told}");
    assert!(told.contains("goes down: `files` failed"), "{told}");
    assert!(!told.contains("have been started"), "{told}");
    let row = summary.lines().find(|row| row.contains("files")).unwrap();
    assert!(row.contains("failed"), "{summary}");
}

#[test]
fn a_service_that_fails_again_and_again_is_given_up_and_the_robot_goes_on() {
    let up = Up::start(&format!("[services]\nrestarts = 2\n{TWO}"), &[]);
    let before = up.processes();
    for state in [
        MemberState::Running,
        MemberState::Running,
        MemberState::Failed,
    ] {
        let events = up.events();
        kill(up.status().services[1].pid.unwrap());
        running::wait(events, "terminals", state);
    }
    let table = String::from_utf8(up.run(&["ps"]).stdout).unwrap();
    let row = table.lines().find(|row| row.contains("terminals")).unwrap();
    assert!(row.contains("failed"), "{table}");
    // Of services and processors, in this order.
    assert_eq!(up.processes()[1..], before[2..]);
    // Who starts it has it tried again.
    up.run(&["start", "terminals"]);
    assert_eq!(
        running::state(&up.status().services[1]),
        MemberState::Running
    );
    let events = up.events();
    up.run(&["stop", "files"]);
    running::wait(events, "files", MemberState::Stopped);
    up.run(&["down"]);
    // What was stopped has not failed.
    assert_eq!(up.end().0, Some(0));
}

#[test]
fn a_note_that_cannot_be_written_takes_nothing_down() {
    let up = Up::start(TWO, &[]);
    let pids = up.directory().pids();
    // Nothing takes the place of a directory.
    std::fs::remove_file(&pids).unwrap();
    std::fs::create_dir(&pids).unwrap();
    let events = up.events();
    kill(up.status().processors[0].pid.unwrap());
    running::wait(events, "a", MemberState::Running);
    let told = up.wait_until_told("cannot write");
    assert!(told.contains(&format!("{pids:?}")), "{told}");
    std::fs::remove_dir(&pids).unwrap();
    // It is made up for in the turn in which the first of these is answered.
    let process = up.status().processors[0].pid.unwrap();
    up.status();
    let noted = std::fs::read_to_string(&pids).unwrap();
    assert!(noted.contains(&format!("{process} ")), "{noted}");
    up.interrupt();
    let (code, _, told) = up.end_telling();
    assert_eq!(code, Some(0));
    assert!(!told.contains("cannot write"), "it is told once: {told}");
}

#[test]
fn a_system_that_has_not_come_up_in_its_time_has_failed() {
    let fails = r#""THIS"
    arguments = ["fails"]
    restarts = 1000000"#;
    let text = TWO.replacen("\"THIS\"\n    arguments = [\"writer\"]", fails, 1);
    let up = Up::launch(&text, &["--for", "1s"], |_| {});
    let (code, summary, told) = up.end_telling();
    assert_eq!(code, Some(1), "{told}");
    assert!(!told.contains("b: started"), "{told}");
    assert!(told.contains("goes down: the time is over"), "{told}");
    assert!(!told.contains("have been started"), "{told}");
    assert!(summary.contains("b          starting"), "{summary}");
}

#[test]
fn a_program_whose_window_is_too_small_says_so_once() {
    let up = Up::launch(TWO, &[], |place| {
        let description = place.join("tested.toml");
        let text = std::fs::read_to_string(&description).unwrap();
        let text = text.replace("window_bytes = 65536", "window_bytes = 4096");
        std::fs::write(description, text).unwrap();
    });
    let failed = up.wait_until_told("a restart would not help");
    assert!(failed.contains(" a: failed: exit status 2"), "{failed}");
    up.wait_until_told("all programs but `a`, `b` have been started");
    let log = std::fs::read_to_string(up.directory().log()).unwrap();
    assert_eq!(log.matches("raise `window_bytes` by").count(), 2, "{log}");
    let states: Vec<_> = up
        .status()
        .processors
        .iter()
        .map(|it| (it.state, it.restarts))
        .collect();
    assert_eq!(states, [(MemberState::Failed, 0); 2]);
}
