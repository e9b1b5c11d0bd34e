//! Whole systems: brought up, killed in parts and as a whole, changed while they run, taken down.

use std::fs::File;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal};

use crate::clock::{DIARIES, log};
use crate::late;
use crate::running::{self, DEADLINE, Up, kill, wait_for_end};
use condor_host::control::{ControlRequest, MemberState};
use condor_host::services::terminals::type_in;

/// Two processors, which write lines and echo what is typed.
pub(crate) const TWO: &str = r#"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["writer"]
    [[processors]]
    number = 5
    name = "b"
    program = "THIS"
    arguments = ["writer"]
"#;

#[test]
fn a_system_comes_up_and_goes_down() {
    let up = Up::start(TWO, &[]);
    let status = up.status();
    assert_eq!(status.system, "tested");
    let names = |members: &[condor_host::control::Member]| {
        let members = members.iter();
        let members =
            members.map(|member| (member.number, member.name.clone(), running::state(member)));
        members.collect::<Vec<_>>()
    };
    let running = |number, name: &str| (number, name.to_owned(), MemberState::Running);
    assert_eq!(
        names(&status.services),
        [running(13, "files"), running(14, "terminals")]
    );
    assert_eq!(
        names(&status.processors),
        [running(0, "a"), running(5, "b")]
    );
    let processes = up.processes();
    let second = up.command(&["up", "--headless"]).output().unwrap();
    let text = String::from_utf8_lossy(&second.stderr).into_owned();
    let expected = format!(
        "the system `tested` is running already, as process {}",
        status.pid
    );
    assert!(
        !second.status.success() && text.contains(&expected),
        "{text}"
    );
    up.run(&["down"]);
    let (code, summary) = up.end();
    assert_eq!(code, Some(0), "{summary}");
    assert!(
        summary.contains("stopped") || summary.contains("running"),
        "{summary}"
    );
    for process in processes {
        wait_for_end(process);
    }
}

#[test]
fn a_killed_processor_is_started_again_and_the_others_go_on() {
    let up = Up::start(TWO, &[]);
    let before = up.status();
    let events = up.events();
    kill(before.processors[0].pid.unwrap());
    running::wait(events, "a", MemberState::Running);
    let after = up.status();
    assert_eq!(after.processors[0].restarts, 1);
    assert_eq!(
        after.processors[0].last_exit.as_deref(),
        Some("killed by SIGKILL")
    );
    assert_ne!(after.processors[0].pid, before.processors[0].pid);
    assert_eq!(after.processors[1], before.processors[1]);
    assert_eq!(after.services, before.services);
    up.interrupt();
    assert_eq!(up.end().0, Some(0));
}

#[test]
fn nothing_outlives_a_killed_supervisor_and_the_next_one_comes_up() {
    let up = Up::start(TWO, &[]);
    let processes = up.processes();
    assert_eq!(processes.len(), 4);
    kill(up.status().pid);
    for process in processes {
        wait_for_end(process);
    }
    let up = up.again();
    assert_eq!(up.processes().len(), 4);
    // And at once, while they are dying.
    kill(up.status().pid);
    let up = up.again();
    up.run(&["down"]);
    assert_eq!(up.end().0, Some(0));
}

/// Whoever hangs, by whichever clock: the others end, it is killed, and `down` names it.
#[test]
fn what_hangs_is_killed_and_named_when_the_system_goes_down() {
    for options in [&[][..], &["--clock", "simulated"]] {
        let hang = |hangs: &[&str]| {
            let up = Up::start(TWO, options);
            let status = up.status();
            for name in hangs {
                let mut members = status.members();
                let member = members.find(|member| member.name == *name).unwrap();
                running::signal(member.pid.unwrap(), Signal::STOP);
            }
            let killed = up.client().down().unwrap();
            up.wait_for_end();
            for name in hangs {
                assert!(
                    killed.iter().any(|it| it == name),
                    "{options:?}: {killed:?}"
                );
            }
        };
        hang(&["a"]);
        hang(&["a", "b", "terminals"]);
    }
}

#[test]
fn a_system_whose_windows_were_removed_goes_down() {
    for options in [&[][..], &["--clock", "simulated"]] {
        let up = Up::start(TWO, options);
        let process = up.status().processors[0].pid.unwrap();
        std::fs::remove_dir_all(up.directory().mailbox()).unwrap();
        kill(process);
        up.wait_until_told("restart 1");
        up.client().down().unwrap();
        up.wait_for_end();
    }
}

#[test]
fn a_running_system_is_not_begun_anew_when_its_lock_was_removed() {
    let up = Up::start(TWO, &[]);
    std::fs::remove_file(up.directory().lock()).unwrap();
    let refused = up.command(&["up", "--headless"]).output().unwrap();
    let text = String::from_utf8(refused.stderr).unwrap();
    assert!(text.contains("is running already, as process"), "{text}");
    assert_eq!(refused.status.code(), Some(1));
    assert_eq!(up.status().processors[0].restarts, 0);
}

#[test]
fn a_processor_is_stopped_and_loaded_and_started_while_the_other_runs() {
    let up = Up::start(TWO, &[]);
    let other = up.status().processors[1].clone();
    up.run(&["stop", "a"]);
    let stopped = up.status().processors[0].clone();
    assert_eq!((stopped.state, stopped.pid), (MemberState::Stopped, None));
    assert_eq!(stopped.last_exit.as_deref(), Some("exit status 0"));
    up.run(&["start", "0"]);
    assert_eq!(
        running::state(&up.status().processors[0]),
        MemberState::Running
    );
    let this = running::this();
    up.run(&["load", "a", this, "writer", "other"]);
    let loaded = up.status().processors[0].clone();
    assert_eq!((loaded.state, loaded.restarts), (MemberState::Running, 0));
    assert_eq!(loaded.arguments, ["writer", "other"]);
    up.read_terminal("a", "writer other 0\r\n");
    // A path is one of the directory in which it is typed.
    let elsewhere = up.path("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    std::os::unix::fs::symlink(up.path(this), elsewhere.join("mine")).unwrap();
    let mut load = up.command(&["load", "a", "./mine", "writer", "other"]);
    let output = load.current_dir(&elsewhere).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let loaded = up.status().processors[0].clone();
    assert_eq!(Path::new(&loaded.program), elsewhere.join("mine"));
    // A restart is that of what runs there now, or ran there last.
    up.run(&["restart", "a"]);
    let again = up.status().processors[0].clone();
    assert_eq!(again.arguments, loaded.arguments);
    assert_ne!(again.pid, loaded.pid);
    up.run(&["stop", "a"]);
    up.run(&["restart", "a"]);
    let loaded = up.status().processors[0].clone();
    assert_eq!(loaded.arguments, again.arguments);
    let service = up.status().services[1].clone();
    up.run(&["restart", &service.name]);
    assert_ne!(up.status().services[1].pid, service.pid);
    let error = up.refused(&ControlRequest::Load {
        processor: "a".into(),
        program: "no-such-program".into(),
        arguments: Vec::new(),
    });
    assert!(
        error.contains("there is no program `no-such-program`"),
        "{error}"
    );
    let error = up.refused(&ControlRequest::Stop {
        processor: "c".into(),
    });
    assert_eq!(
        error,
        "there is no processor or service `c`; there are files, terminals, a, b"
    );
    let error = up.refused(&ControlRequest::Start {
        processor: "a".into(),
    });
    assert_eq!(error, "`a` is running already; `restart` ends it first");
    assert_eq!(up.status().processors[0].pid, loaded.pid);
    assert_eq!(up.status().processors[1], other);
}

#[test]
fn a_program_that_fails_again_and_again_has_failed_for_good() {
    let text = r#"
        [[processors]]
        number = 1
        name = "a"
        program = "THIS"
        arguments = ["fails"]
        restarts = 2
        [[processors]]
        number = 2
        name = "b"
        program = "THIS"
        arguments = ["writer"]
    "#;
    let up = Up::start(text, &[]);
    let failed = up.status().processors[0].clone();
    assert_eq!((failed.state, failed.restarts), (MemberState::Failed, 2));
    assert_eq!(failed.last_exit.as_deref(), Some("exit status 3"));
    assert_eq!(
        running::state(&up.status().processors[1]),
        MemberState::Running
    );
    let log = String::from_utf8(up.run(&["log"]).stdout).unwrap();
    assert!(log.contains("a: this program fails"), "{log}");
    up.run(&["down"]);
    assert_eq!(up.end().0, Some(1));
}

#[test]
fn a_program_that_must_not_fail_ends_the_system() {
    let text = r#"
        [[processors]]
        number = 1
        name = "a"
        program = "THIS"
        arguments = ["writer"]
        on_failure = "stop"
    "#;
    let up = Up::start(text, &[]);
    let process = up.status().processors[0].pid.unwrap();
    kill(process);
    assert_eq!(up.end().0, Some(1));
}

#[test]
fn a_program_whose_heart_stands_still_is_started_again() {
    let text = r#"
        [[processors]]
        number = 1
        name = "a"
        program = "THIS"
        arguments = ["writer"]
        stall_seconds = 3
    "#;
    let up = Up::start(text, &[]);
    let events = up.events();
    let mut terminal = up.terminal("a");
    terminal.write_all(b"stall\r").unwrap();
    let events = running::wait(events, "a", MemberState::Stalled);
    running::wait(events, "a", MemberState::Running);
    assert_eq!(up.status().processors[0].restarts, 1);
}

#[test]
fn the_log_of_a_terminal_has_every_line_once_whatever_is_killed() {
    let up = Up::start(TWO, &[]);
    for _ in 0..10 {
        let events = up.events();
        kill(up.status().services[1].pid.unwrap());
        running::wait(events, "terminals", MemberState::Running);
        // It goes on where the one before stopped, or this never comes.
        let already = up.lines("a");
        up.read_terminal("a", &format!("writer {}\r\n", already + 50));
    }
    let status = up.status();
    assert_eq!(status.services[1].restarts, 10);
    assert_eq!(status.processors[0].restarts, 0);
    assert!(up.lines("a") >= 500);
    up.run(&["stop", "a"]);
    // `lines` has compared every line.
    up.lines("a");
}

#[test]
fn the_last_words_of_a_program_are_in_its_log() {
    let up = Up::start(DIARIES, &[]);
    up.read_terminal("a", "Ok(");
    // The service finds what they wrote at last together with the signal that ends it.
    let service = up.status().services[1].pid.unwrap();
    running::signal(service, Signal::STOP);
    up.interrupt();
    while up.status().processors.iter().any(|it| it.pid.is_some()) {}
    running::signal(service, Signal::CONT);
    up.wait_for_end();
    for (name, file) in [("a", "files/diary-0"), ("b", "files/diary-5")] {
        let log = log(&up.directory().terminals(), name);
        assert_eq!(log.lines().count(), up.file(file).lines().count(), "{log}");
    }
}

#[test]
fn what_is_typed_on_a_socket_reaches_the_program() {
    let up = Up::start(TWO, &[]);
    let mut first = up.terminal("b");
    first.write_all(b"hello\r").unwrap();
    running::read_until(&mut first, "typed hello\r\n");
    // Who comes later is shown what was before.
    let mut second = up.terminal("b");
    running::read_until(&mut second, "typed hello\r\n");
}

#[test]
fn what_the_description_types_is_answered_in_the_summary() {
    let arguments = r#"arguments = ["writer"]"#;
    let typed = TWO.replacen(
        arguments,
        &format!("{arguments}\nheadless = [\"hello\"]"),
        1,
    );
    let up = Up::start(&typed, &[]);
    up.read_terminal("a", "typed hello\r\n");
    up.interrupt();
    let (code, summary) = up.end();
    assert_eq!(code, Some(0));
    let (_, answers) = summary.split_once("terminal of a:\n").unwrap();
    assert!(answers.contains("typed hello\n"), "{summary}");
    assert!(!summary.contains("terminal of b:"), "{summary}");
}

#[test]
fn what_is_typed_reaches_the_program_once_whatever_is_killed() {
    let up = Up::start(TWO, &[]);
    let mut typed = 0;
    let mut type_some = |count: usize| {
        for _ in 0..count {
            let line = format!("line {typed}\n");
            type_in(&up.directory(), "a", line.as_bytes()).unwrap();
            typed += 1;
        }
        typed
    };
    for _ in 0..10 {
        let events = up.events();
        type_some(20);
        kill(up.status().services[1].pid.unwrap());
        type_some(20);
        running::wait(events, "terminals", MemberState::Running);
    }
    let last = type_some(1);
    up.read_terminal("a", &format!("typed line {}\r\n", last - 1));
    let log = up.directory().terminals().join("a.log");
    let text = std::fs::read_to_string(log).unwrap();
    let lines: Vec<_> = text.lines().filter(|it| it.starts_with("typed")).collect();
    let expected: Vec<_> = (0..last).map(|it| format!("typed line {it}")).collect();
    assert_eq!(lines, expected);
    assert_eq!(up.status().services[1].restarts, 10);
}

#[test]
fn what_is_typed_in_a_first_incarnation_is_for_the_second() {
    let late = TWO.replacen("writer", "late", 1);
    let up = Up::start(&late, &[]);
    up.read_terminal("a", "first\r\n");
    type_in(&up.directory(), "a", b"early\n").unwrap();
    std::fs::write(up.path("files").join(late::GO), "").unwrap();
    up.read_terminal("a", "got early\r\n");
    let log = up.directory().terminals().join("a.log");
    let log = std::fs::read_to_string(log).unwrap();
    let lives: Vec<_> = log.split("[began at ").skip(1).collect();
    let [first, second] = lives.as_slice() else {
        panic!("{log}");
    };
    assert!(first.ends_with("]\r\nfirst\r\n\r\n"), "{log}");
    // The echo may come first.
    for line in ["second\r\n", "early\r\n", "got early\r\n"] {
        assert!(second.contains(line), "{log}");
    }
}

#[test]
fn what_is_typed_on_a_pseudo_terminal_reaches_the_program() {
    let up = Up::start(TWO, &[]);
    let path = up.directory().terminals().join("b");
    let mut pty = std::fs::File::options()
        .read(true)
        .write(true)
        .open(path)
        .unwrap();
    pty.write_all(b"hello\r").unwrap();
    running::read_until(&mut pty, "typed hello\r\n");
}

#[test]
fn the_file_service_is_started_again() {
    let up = Up::start(TWO, &[]);
    let events = up.events();
    kill(up.status().services[0].pid.unwrap());
    running::wait(events, "files", MemberState::Running);
    let files = up.status().services[0].clone();
    assert_eq!(
        (files.restarts, running::state(&files)),
        (1, MemberState::Running)
    );
}

#[test]
fn a_request_that_is_none_is_refused_and_the_next_one_answered() {
    let up = Up::start(TWO, &[]);
    let mut stream = UnixStream::connect(up.directory().control()).unwrap();
    stream.set_read_timeout(Some(DEADLINE)).unwrap();
    stream
        .write_all(b"{\"do\":\"dance\"}\nnonsense\n{\"do\":\"status\"}\n")
        .unwrap();
    stream.shutdown(std::net::Shutdown::Write).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let lines: Vec<_> = text.lines().collect();
    assert_eq!(lines.len(), 3, "{text}");
    assert!(
        lines[0].starts_with(
            "{\"ok\":false,\"error\":\"cannot understand the request: unknown variant `dance`"
        ),
        "{text}"
    );
    assert!(lines[1].starts_with("{\"ok\":false"), "{text}");
    assert!(
        lines[2].starts_with("{\"ok\":true,\"system\":\"tested\""),
        "{text}"
    );
}

#[test]
fn a_time_ends_it_and_the_summary_is_json() {
    let up = Up::start(TWO, &["--for", "2s", "--json"]);
    let (code, summary) = up.end();
    assert_eq!(code, Some(0));
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["processors"][1]["name"], "b");
    assert_eq!(summary["processors"][1]["state"], "running");
}

/// After a kill of everybody, numbers of the former processes may be those of others: of a process, or of a group
/// whose leader has gone.
#[test]
fn processes_of_others_that_have_former_numbers_live() {
    let up = Up::start(TWO, &[]);
    let mut stranger = Command::new("sleep");
    stranger
        .arg("300")
        .process_group(0)
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut stranger = stranger.spawn().unwrap();
    let mut leader = Command::new("sh");
    leader.args(["-c", "sleep 300 >/dev/null 2>&1 & echo $!"]);
    let leader = leader
        .process_group(0)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let group = leader.id();
    let member = leader.wait_with_output().unwrap().stdout;
    let member: u32 = String::from_utf8(member).unwrap().trim().parse().unwrap();
    kill(up.status().pid);
    up.wait_for_end();
    let mut pids = File::options()
        .append(true)
        .open(up.directory().pids())
        .unwrap();
    writeln!(pids, "{} 1\n{group} 1", stranger.id()).unwrap();
    let up = up.again();
    assert!(stranger.try_wait().unwrap().is_none());
    let of_member = Pid::from_raw(member.cast_signed()).unwrap();
    rustix::process::test_kill_process(of_member).unwrap();
    kill(member);
    stranger.kill().unwrap();
    stranger.wait().unwrap();
    up.interrupt();
    assert_eq!(up.end().0, Some(0));
}
