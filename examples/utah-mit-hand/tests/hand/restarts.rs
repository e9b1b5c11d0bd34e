//! The master restarts errant programs: what is typed at its terminal, in a system of processes and in
//! simulated time.

use std::process::Command;

use condor_host::control::SystemStatus;
use rustix::process::{Pid, Signal, kill_process};

use crate::up::Up;

fn process(status: &SystemStatus, name: &str) -> Option<u32> {
    let mut members = status.members();
    members.find(|it| it.name == name).and_then(|it| it.pid)
}

/// "(c) … or restart errant programs."
#[test]
fn c_it_can_restart_errant_programs() {
    const NAME: &str = "restarts";
    let mut up = Up::start(NAME, "max", |text| text);
    up.expect("wave is done\n");
    let before = up.status();
    // The program that serves ring and thumb is another one now, which serves nothing.
    up.types("load servo-b self table");
    up.expect("processor 2 is gone: nothing controls ring and thumb\n");
    up.expect("load servo-b: done\n");
    up.types("status");
    up.expect("ring   gone");
    up.types("load 2 self servo");
    up.expect("load 2: done\n");
    up.types("enable");
    up.types("status");
    up.expect("ring   follows");
    let loaded = up.status();
    assert_ne!(process(&loaded, "servo-b"), process(&before, "servo-b"));
    // And the same program again, by its name and by its number.
    up.types("restart servo-a");
    up.expect("restart servo-a: done\n");
    up.types("restart 2");
    up.expect("restart 2: done\n");
    let after = up.status();
    for (name, restarted) in [
        ("servo-a", true),
        ("servo-b", true),
        ("table", false),
        ("plant", false),
        ("master", false),
        ("files", false),
    ] {
        let is_other = process(&after, name) != process(&loaded, name);
        assert_eq!(is_other, restarted, "{name}");
    }
    up.types("enable");
    up.types("run open");
    up.expect("open is done\n");
}

/// "The master ends. No set-points come any more, and after 60 ms each finger that follows has a fault": in
/// simulated time, too, in which the start of its next incarnation takes no time of the machine's.
#[test]
fn fingers_are_off_after_the_master_was_killed_until_a_person_enables_them() {
    // Nothing is typed at its next incarnation.
    let mut up = Up::start("killed-master", "max", |text| {
        text.replace("run wave", "run open")
    });
    up.expect("open is done\n");
    let motion = |up: &Up| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"));
        let command = command.args(["motion", "--control", "pinch"]);
        let output = command.env("XDG_RUNTIME_DIR", up.place()).output().unwrap();
        let text = [output.stdout, output.stderr].concat();
        (output.status.success(), String::from_utf8(text).unwrap())
    };
    assert_eq!(motion(&up), (true, "pinch: done\n".to_owned()));
    let master = process(&up.status(), "master").unwrap();
    let pid = Pid::from_raw(master.cast_signed()).unwrap();
    kill_process(pid, Signal::KILL).unwrap();
    up.expect("`help` lists the commands\n");
    for finger in ["index", "middle", "ring", "thumb"] {
        up.expect(&format!("{finger} has a fault"));
        up.expect("no new set-point");
    }
    let (is_done, text) = motion(&up);
    assert!(
        !is_done && text.to_lowercase().contains("refused"),
        "{text}"
    );
    up.types("enable");
    up.types("status");
    up.expect("thumb  follows");
    assert_eq!(motion(&up), (true, "pinch: done\n".to_owned()));
}
