//! Systems and commands on a small filesystem of their own, which is full.

use std::process::{Command, Output};

use crate::running::Up;
use crate::supervisor::TWO;

/// Runs a script of the shell in which `DISK` is the directory of a filesystem of this size, which nobody
/// else sees, and `$0` is `condor`; `None` if no filesystem may be mounted here.
pub(crate) fn with(up: &Up, size: &str, script: &str) -> Option<Output> {
    let disk = up.path("disk");
    let disk = disk.to_str().unwrap();
    let mount = format!("mkdir {disk}; mount -t tmpfs -o size={size} disk {disk}");
    let run = |script: &str| {
        let condor = up.command(&[]);
        let mut unshare = Command::new("unshare");
        unshare.args(["--map-root-user", "--mount", "sh", "-ec", script]);
        unshare.arg(condor.get_program());
        for (name, value) in condor.get_envs() {
            unshare.env(name, value.unwrap());
        }
        unshare.output().unwrap()
    };
    let probe = run(&mount);
    std::fs::remove_dir(disk).unwrap();
    if !probe.status.success() {
        let why = String::from_utf8_lossy(&probe.stderr);
        println!("SKIPPED: no filesystem may be mounted here: {why}");
        return None;
    }
    let script = script.replace("DISK", disk);
    Some(run(&format!("{mount}; {script}")))
}

/// The first program fills the disk, so that the terminals have no room for a log, nor for their marks.
#[test]
fn a_disk_that_is_full_stops_no_time_and_no_program() {
    let up = Up::start(TWO, &[]);
    let filler = "#!/bin/sh\ncat /dev/zero >\"$XDG_RUNTIME_DIR/fill\" 2>/dev/null\nexec \"${0%filler}program\" \"$@\"\n";
    std::fs::write(up.path("filler"), filler).unwrap();
    let text = up
        .file("tested.toml")
        .replacen("\"program\"", "\"filler\"", 1);
    // Those of the other system are served.
    let text = text.replace("\"files\"", "\"other\"");
    std::fs::write(up.path("full.toml"), text).unwrap();
    // By the real clock, a busy machine takes its time to start all.
    for (clock, time) in [("simulated", "500ms"), ("real", "5s")] {
        let script = format!(
            "chmod +x DISK/../filler; XDG_RUNTIME_DIR=DISK timeout 100 \
             \"$0\" up DISK/../full.toml --headless --clock {clock} --for {time}"
        );
        let Some(output) = with(&up, "32m", &script) else {
            return;
        };
        let told = String::from_utf8_lossy(&output.stderr);
        let summary = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{clock}: {told}{summary}");
        assert!(told.contains("No space left"), "{clock}: {told}");
        assert!(told.contains("the time is over"), "{clock}: {told}");
        std::fs::remove_dir(up.path("disk")).unwrap();
    }
}

#[test]
fn memory_for_which_there_is_no_room_is_an_error_before_any_program_runs() {
    let up = Up::start(TWO, &[]);
    let text = up.file("tested.toml");
    let text = format!("{text}\n[shared_memory]\nbytes = 16777216\n");
    std::fs::write(up.path("full.toml"), text).unwrap();
    let script = "XDG_RUNTIME_DIR=DISK \"$0\" up DISK/../full.toml --headless || echo $?";
    let Some(output) = with(&up, "12m", script) else {
        return;
    };
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(String::from_utf8_lossy(&output.stdout), "1\n", "{told}");
    assert!(told.contains("No space left"), "{told}");
    assert!(!told.contains("started"), "{told}");
}
