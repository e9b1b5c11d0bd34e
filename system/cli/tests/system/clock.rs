//! Systems in simulated time: stopped, stepped, repeated, and with parts of them killed.

use std::path::Path;
use std::time::{Duration, Instant};

use condor_host::control::{ClockStatus, MemberState};
use condor_host::services::terminals::type_in;
use rustix::process::{Pid, Signal, kill_process};

use crate::diary::FILE;
use crate::running::{self, DEADLINE, Up, kill, signal};
use crate::supervisor::TWO;

pub(crate) const SIMULATED: &[&str] = &["--clock", "simulated"];

/// Two processors that write down what they do and ask each other.
pub(crate) const DIARIES: &str = r#"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["diary", "5"]
    headless = ["of a", "more of a"]
    [[processors]]
    number = 5
    name = "b"
    program = "THIS"
    arguments = ["diary", "0"]
    headless = ["of b"]
"#;

fn clock(up: &Up) -> ClockStatus {
    up.status().clock.expect("a simulated clock")
}

/// Asks for the state of the clock until it is as wanted.
fn until(up: &Up, wanted: impl Fn(&ClockStatus) -> bool) -> ClockStatus {
    let end = Instant::now() + DEADLINE;
    loop {
        let now = clock(up);
        if wanted(&now) {
            return now;
        }
        assert!(Instant::now() < end, "{now:?}");
    }
}

/// Waits until no thread of a process that was sent SIGSTOP runs.
fn wait_for_stop(process: u32) {
    let end = Instant::now() + DEADLINE;
    loop {
        let status = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
        // The state comes after the name, which is in parentheses.
        let state = status.rsplit_once(')').unwrap().1.trim_start();
        if state.starts_with('T') {
            return;
        }
        assert!(Instant::now() < end, "{status}");
    }
}

fn stands(clock: &ClockStatus) -> bool {
    clock.waits_for == "`resume` or `step`"
}

fn told(up: &Up, arguments: &[&str]) -> String {
    String::from_utf8(up.run(arguments).stdout).unwrap()
}

fn complaint(up: &Up, arguments: &[&str]) -> String {
    let output = up.command(arguments).output().unwrap();
    assert!(!output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn time_is_paused_and_stepped_and_goes_on() {
    let up = Up::start(TWO, SIMULATED);
    until(&up, |clock| clock.seconds > 0.0);
    told(&up, &["clock", "pause"]);
    let before = until(&up, stands).seconds;
    let lines = up.lines("a");
    assert_eq!(
        (Some(clock(&up).seconds), up.lines("a")),
        (Some(before), lines)
    );
    let ps = told(&up, &["ps"]);
    assert!(
        ps.contains("paused); it waits for `resume` or `step`"),
        "{ps}"
    );
    // Both write a line in every two milliseconds.
    for step in 1..=3_u8 {
        told(&up, &["clock", "step", "100ms"]);
        let now = until(&up, stands);
        let passed = now.seconds - before;
        assert!((passed - 0.1 * f64::from(step)).abs() < 1e-9, "{passed}");
        assert_eq!(up.lines("a"), lines + 50 * usize::from(step));
    }
    told(&up, &["clock", "speed", "0.5"]);
    let text = told(&up, &["top", "--once", "--every", "1ms"]);
    assert!(text.contains("(speed 0.5, paused)"), "{text}");
    told(&up, &["clock", "resume"]);
    let then = clock(&up).seconds;
    until(&up, |clock| clock.seconds > then);
    let text = told(&up, &["clock", "speed", "max"]);
    assert!(text.contains("(speed max)"), "{text}");
    up.run(&["down"]);
    let (code, summary) = up.end();
    assert_eq!(code, Some(0));
    assert!(summary.contains("simulated time: "), "{summary}");
}

#[test]
fn a_real_clock_says_so() {
    let up = Up::start(TWO, &[]);
    assert_eq!(told(&up, &["clock"]), "real clock\n");
}

#[test]
fn a_program_that_is_stopped_stops_time_which_says_so() {
    let up = Up::start(TWO, SIMULATED);
    let process = up.status().processors[1].pid.unwrap();
    signal(process, Signal::STOP);
    // Until then it may have the turn and give it away.
    wait_for_stop(process);
    let stopped = until(&up, |clock| {
        clock.waits_for == "processor 5, which has the turn"
    });
    let ps = told(&up, &["ps"]);
    assert!(
        ps.contains("it waits for processor 5, which has the turn"),
        "{ps}"
    );
    let wrong = complaint(&up, &["clock", "pause"]);
    let reason = "the clock waits for processor 5, which has the turn";
    assert!(wrong.contains(reason), "{wrong}");
    assert_eq!(Some(clock(&up).seconds), Some(stopped.seconds));
    signal(process, Signal::CONT);
    until(&up, |clock| clock.seconds > stopped.seconds);
}

#[test]
fn time_stands_until_a_killed_program_has_entered_again() {
    let up = Up::start(TWO, SIMULATED);
    let mut stood = None;
    for _ in 0..8 {
        let events = up.events();
        kill(up.status().processors[0].pid.unwrap());
        running::wait(events, "a", MemberState::Restarting);
        loop {
            let status = up.status();
            if status.processors[0].state != MemberState::Restarting {
                break;
            }
            let clock = status.clock.unwrap();
            if clock.waits_for != "the program of processor 0, which does not run yet" {
                // The other one still has the turn, or the program has just entered again.
                if stood.is_some() {
                    break;
                }
                continue;
            }
            let before = *stood.get_or_insert(clock.seconds);
            assert!((clock.seconds - before).abs() < f64::EPSILON, "{clock:?}");
        }
        until(&up, |clock| stood.is_none_or(|then| clock.seconds > then));
        let ended = stood.take();
        if ended.is_some() && up.status().processors[0].restarts > 3 {
            up.run(&["down"]);
            return;
        }
        let events = up.events();
        if up.status().processors[0].state != MemberState::Running {
            running::wait(events, "a", MemberState::Running);
        }
    }
    panic!("nobody saw that it was being restarted");
}

/// The others see that it is gone, as by the real clock: a restart that took no time would be hidden from
/// every watchdog.
#[test]
fn a_restart_takes_simulated_time_in_which_others_go_on() {
    const RESTART: u64 = 100_000_000;
    let up = Up::start(DIARIES, SIMULATED);
    // By a request, by a kill, and by a kill while time stands, in which `start` does not wait for time.
    let restarts: [&dyn Fn(u32); 3] = [
        &|_| drop(up.run(&["restart", "a"])),
        &|process| kill(process),
        &|process| {
            up.run(&["clock", "pause"]);
            let events = up.events();
            kill(process);
            running::wait(events, "a", MemberState::Starting);
            up.run(&["start", "a"]);
            up.run(&["clock", "resume"]);
        },
    ];
    // It writes its first line a while after it has joined.
    let until_incarnation = |incarnation| {
        let end = Instant::now() + DEADLINE;
        while lives(&instants(&up, 0), RESTART) < incarnation {
            assert!(
                Instant::now() < end,
                "incarnation {incarnation} is not to be seen"
            );
        }
    };
    until_incarnation(1);
    for (incarnation, restart) in (2..).zip(restarts) {
        let events = up.events();
        restart(up.status().processors[0].pid.unwrap());
        running::wait(events, "a", MemberState::Running);
        until_incarnation(incarnation);
    }
    up.run(&["down"]);
    up.wait_for_end();
    let (killed, other) = (instants(&up, 0), instants(&up, 5));
    assert_eq!(lives(&killed, RESTART), 4);
    for pair in killed
        .windows(2)
        .filter(|pair| pair[1] - pair[0] >= RESTART)
    {
        // It writes a line in every 20 ms.
        let between = other.iter().filter(|&&at| pair[0] < at && at < pair[1]);
        assert!(between.count() >= 4, "{pair:?}");
    }
}

/// When the diary of a processor has lines, in nanoseconds.
fn instants(up: &Up, number: u8) -> Vec<u64> {
    let path = up.path(&format!("files/diary-{number}"));
    let text = std::fs::read_to_string(path).unwrap_or_default();
    // The last line may be half written.
    let lines = text
        .split_inclusive('\n')
        .filter(|line| line.ends_with('\n'));
    let instants = lines.map(|line| line.split(' ').next().unwrap().parse().unwrap());
    instants.collect()
}

/// How many incarnations of a program these lines are of, if a restart takes so long.
fn lives(instants: &[u64], restart: u64) -> usize {
    let restarts = instants.windows(2);
    let restarts = restarts.filter(|pair| pair[1] - pair[0] >= restart);
    restarts.count() + usize::from(!instants.is_empty())
}

#[test]
fn a_wait_for_a_service_that_was_given_up_ends_by_its_deadline() {
    let up = Up::start(DIARIES, SIMULATED);
    up.read_terminal("a", "Ok(");
    up.run(&["stop", "files"]);
    up.read_terminal("a", "Err(");
    up.run(&["down"]);
    up.wait_for_end();
    let text = log(&up.directory().terminals(), "a");
    let took = |line: &str| -> Duration {
        let mut words = line.split(' ').map(|word| word.parse().unwrap());
        let [began, ended]: [u64; 2] = [(); 2].map(|()| words.next().unwrap());
        Duration::from_nanos(ended - began)
    };
    let times = |outcome| {
        let lines = text.lines().filter(move |line| line.contains(outcome));
        lines.map(took).collect::<Vec<_>>()
    };
    // As long as it was there, it cost no time.
    let (served, given_up) = (times("Ok("), times("Err("));
    assert!(
        !served.is_empty() && served.iter().all(Duration::is_zero),
        "{text}"
    );
    // It asks again in every millisecond.
    let deadline = FILE..=FILE + Duration::from_millis(1);
    assert!(deadline.contains(given_up.first().unwrap()), "{text}");
}

/// What a terminal has written, from after the line that says when it began.
pub(crate) fn log(terminals: &Path, name: &str) -> String {
    let text = std::fs::read_to_string(terminals.join(format!("{name}.log"))).unwrap();
    text.split_once("]\r\n").unwrap().1.to_owned()
}

/// What the terminals and the files say after a run of the diaries.
pub(crate) fn outcome(up: &Up) -> [String; 4] {
    up.wait_for_end();
    let terminals = up.directory().terminals();
    let file = |number| up.file(&format!("files/diary-{number}"));
    [log(&terminals, "a"), log(&terminals, "b"), file(0), file(5)]
}

pub(crate) fn assert_same(one: &[String; 4], other: &[String; 4]) {
    for (one, other) in one.iter().zip(other) {
        // The first line that differs says more than all of them; one may go on where the other ends.
        let (mut lines, mut others) = (one.lines(), other.lines());
        loop {
            let line = lines.next();
            assert_eq!(line, others.next());
            if line.is_none() {
                break;
            }
        }
        assert_eq!(one.len(), other.len());
    }
}

#[test]
fn killed_services_change_nothing_in_a_run() {
    let run = |speed| {
        let options = [SIMULATED, &["--for", "3s", "--speed", speed]].concat();
        Up::launch(DIARIES, &options, |_| {})
    };
    let undisturbed = outcome(&run("max"));
    for typed in ["of a", "more of a"] {
        assert!(undisturbed[0].contains(typed), "{undisturbed:?}");
    }
    assert!(undisturbed[0].lines().count() > 100, "{undisturbed:?}");
    let up = run("1");
    up.wait_until_started();
    let kills = kill_services_until(&up, 2.9, |_| {});
    let disturbed = outcome(&up);
    assert!(kills > 4, "{kills}");
    assert_same(&undisturbed, &disturbed);
}

/// Kills services as soon as they run again, until an instant in seconds.
fn kill_services_until(up: &Up, seconds: f64, mut between: impl FnMut(f64)) -> i32 {
    let mut kills = 0;
    while let Ok(status) = up.client().status() {
        let now = status.clock.map_or(seconds, |clock| clock.seconds);
        if now >= seconds {
            break;
        }
        between(now);
        for service in &status.services {
            if service.state == MemberState::Running
                && let Some(process) = service.pid
                && service.restarts < 9
            {
                // It may have ended meanwhile.
                let process = Pid::from_raw(process.cast_signed()).unwrap();
                kills += i32::from(kill_process(process, Signal::KILL).is_ok());
            }
        }
    }
    kills
}

/// A record of typing, in which pieces that were typed together are one.
fn record(up: &Up) -> Vec<(String, String)> {
    let text = up.file("condor/tested/typing");
    let mut pieces: Vec<(String, String)> = Vec::new();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("condor typing 1"));
    for line in lines {
        let mut parts = line.splitn(4, ' ');
        let [at, name, _, text] = [(); 4].map(|()| parts.next().unwrap());
        let at = format!("{at} {name}");
        match pieces.last_mut() {
            Some((last, before)) if *last == at => before.push_str(text),
            _ => pieces.push((at, text.into())),
        }
    }
    pieces
}

#[test]
fn what_was_typed_is_typed_again_at_the_same_instants() {
    let options = |more: &[&'static str]| [SIMULATED, &["--for", "3s"], more].concat();
    let first = Up::launch(DIARIES, &options(&[]), |_| {});
    first.wait_until_started();
    let mut count = 0;
    let kills = kill_services_until(&first, 2.8, |now| {
        if now > 0.1 * f64::from(count) {
            let name = if count % 3 == 0 { "b" } else { "a" };
            let line = format!("line {count} é\\\n");
            type_in(&first.directory(), name, line.as_bytes()).unwrap();
            count += 1;
        }
    });
    assert!(kills > 4 && count > 10, "{kills} {count}");
    let (outcome_before, record_before) = (outcome(&first), record(&first));
    for line in 0..count - 1 {
        let typed = format!("line {line} é\\ ");
        let logs = outcome_before[..2].concat();
        assert_eq!(logs.matches(&typed).count(), 1, "{line}: {logs}");
    }
    let text = first.file("condor/tested/typing");
    for (speed, kills) in [("--speed=max", false), ("--speed=1", true)] {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("typing");
        std::fs::write(&file, &text).unwrap();
        let file = file.display().to_string();
        let options = [&options(&[speed])[..], &["--typing", &file]].concat();
        let again = Up::launch(DIARIES, &options, |_| {});
        if kills {
            again.wait_until_started();
            assert!(kill_services_until(&again, 2.9, |_| {}) > 4);
        }
        let (outcome, record) = (outcome(&again), record(&again));
        for (one, other) in record_before.iter().zip(&record) {
            assert_eq!(one, other);
        }
        assert_eq!(record_before.len(), record.len());
        assert_same(&outcome_before, &outcome);
    }
}

#[test]
fn a_record_that_is_wrong_is_refused_before_anything_starts() {
    for (clock, text, expected) in [
        (
            "simulated",
            "condor typing 1\n0 a 0 x\n0 c 0 x",
            "typing:3: there is no processor `c`; there are a, b",
        ),
        (
            "simulated",
            "condor typing 2\n",
            "typing:1: this is no record of typing",
        ),
        (
            "real",
            "condor typing 1\n",
            "--typing needs a simulated clock",
        ),
    ] {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("typing");
        std::fs::write(&file, text).unwrap();
        let file = file.display().to_string();
        let up = Up::launch(TWO, &["--clock", clock, "--typing", &file], |_| {});
        let (code, _, told) = up.end_telling();
        assert_eq!(code, Some(1), "{told}");
        assert!(told.contains(expected), "{told}");
        assert!(!told.contains("comes up"), "{told}");
    }
}
