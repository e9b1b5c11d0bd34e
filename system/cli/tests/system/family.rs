//! Descendants of programs: whatever they have done to get away, none outlives the supervisor.

use crate::running::{self, Up, kill, wait_for_end};
use condor_host::control::MemberState;

const PARENT: &str = r#"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["parent"]
"#;

/// A system whose program has a child in its group, and one that has detached itself.
fn start() -> (Up, [u32; 2]) {
    let up = Up::launch(PARENT, &[], |_| {});
    let descendants = [(); 2].map(|()| {
        let line = up.wait_until_told("descendant ");
        let (_, process) = line.rsplit_once(' ').unwrap();
        process.trim().parse().unwrap()
    });
    up.wait_until_started();
    (up, descendants)
}

#[test]
fn the_group_of_a_program_ends_with_it() {
    let (up, [child, _]) = start();
    let events = up.events();
    kill(up.status().processors[0].pid.unwrap());
    wait_for_end(child);
    running::wait(events, "a", MemberState::Running);
}

#[test]
fn nothing_outlives_a_supervisor_that_ends() {
    let (up, descendants) = start();
    up.run(&["down"]);
    // Its keeper ends after the last of them.
    assert_eq!(up.end().0, Some(0));
    descendants.into_iter().for_each(has_ended);
}

#[test]
fn nothing_outlives_a_supervisor_that_is_killed() {
    let (up, descendants) = start();
    kill(up.status().pid);
    let (code, _, told) = up.end_telling();
    assert_eq!(code, Some(1));
    assert!(told.contains("the supervisor was killed"), "{told}");
    descendants.into_iter().for_each(has_ended);
}

#[test]
fn a_supervisor_whose_keeper_is_killed_takes_the_system_down() {
    let (up, descendants) = start();
    let processes = up.processes();
    let supervisor = up.status().pid;
    up.kill_keeper();
    wait_for_end(supervisor);
    processes.into_iter().for_each(wait_for_end);
    descendants.into_iter().for_each(wait_for_end);
}

fn has_ended(process: u32) {
    let process = rustix::process::Pid::from_raw(process.cast_signed()).unwrap();
    let there = rustix::process::test_kill_process(process);
    assert_eq!(there, Err(rustix::io::Errno::SRCH), "{process:?} lives on");
}
