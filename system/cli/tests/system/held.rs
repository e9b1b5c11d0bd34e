//! Programs that wait for a debugger.

use std::hint::black_box;
use std::os::unix::fs::PermissionsExt;
use std::process::Output;
use std::time::Instant;

use condor_host::control::MemberState;
use condor_rt::{LoopTick, Machine, Program, ProgramError, Rate, Setup};
use rustix::process::Signal;

use crate::clock::SIMULATED;
use crate::running::{self, DEADLINE, Up, signal};

/// Two processors, the first of which has these keys, too.
fn processors(program: &str, keys: &str) -> String {
    let words: Vec<_> = program.split(' ').map(|word| format!("{word:?}")).collect();
    let words = words.join(", ");
    format!(
        "[[processors]]\nnumber = 0\nname = \"a\"\nprogram = \"THIS\"\narguments = [{words}]\n{keys}\n\
         [[processors]]\nnumber = 5\nname = \"b\"\nprogram = \"THIS\"\narguments = [\"writer\"]\n"
    )
}

const HELD: &str = "hold_exceptions = true\n";

/// A servo loop that divides zero by zero, or panics if the program has an argument.
pub(crate) struct Divider;

impl Program for Divider {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let panics = machine.argument(0).is_some();
        let mut divide = |_: &mut LoopTick<'_>| {
            assert!(!panics, "this loop has no divisor");
            black_box(black_box(0.0_f64) / black_box(0.0));
        };
        let mut setup = Setup::new(machine)?;
        setup.servo("divide", Rate::hz(100), &mut divide).run()
    }
}

/// Sends the program of `a` the signal of an error, and waits until it is held.
fn hold(up: &Up) {
    let events = up.events();
    signal(up.status().processors[0].pid.unwrap(), Signal::SEGV);
    running::wait(events, "a", MemberState::Held);
}

fn until(mut is_so: impl FnMut() -> bool) {
    let end = Instant::now() + DEADLINE;
    while !is_so() {
        assert!(Instant::now() < end, "it does not come");
    }
}

fn text(output: &Output) -> String {
    let all = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8(all).unwrap()
}

#[test]
fn a_fatal_error_holds_a_program_while_the_others_go_on() {
    let up = Up::start(&processors("writer", HELD), &[]);
    hold(&up);
    let held = up.status().processors[0].clone();
    let shown = || std::fs::metadata(up.directory().terminals().join("b.log")).unwrap();
    let before = shown().len();
    until(|| shown().len() > before);
    assert_eq!(up.status().processors[0], held, "it waits");
    let log = text(&up.run(&["log"]));
    for said in [
        "a: fatal error: SIGSEGV, a memory access that is not allowed",
        "a: is held for a debugger: `",
        " gdb a` attaches one, `",
        " restart a` starts the program anew",
    ] {
        assert!(log.contains(said), "{said}:\n{log}");
    }
    let ps = text(&up.run(&["ps"]));
    assert!(ps.contains(" held "), "{ps}");
    // A debugger that goes away without repairing anything.
    let events = up.events();
    signal(held.pid.unwrap(), Signal::CONT);
    let events = running::wait(events, "a", MemberState::Restarting);
    running::wait(events, "a", MemberState::Running);
    let after = up.status().processors[0].clone();
    assert_eq!(after.last_exit.as_deref(), Some("killed by SIGSEGV"));
    hold(&up);
    up.run(&["restart", "a"]);
    assert_eq!(up.status().processors[0].state, MemberState::Running);
    hold(&up);
    up.run(&["down"]);
    let (code, _) = up.end();
    assert_eq!(code, Some(1), "the one that is held has failed");
}

#[test]
fn without_the_key_it_is_started_again() {
    let up = Up::start(&processors("writer", ""), &[]);
    let events = up.events();
    // The handler of std ignores a SIGSEGV that somebody has sent.
    signal(up.status().processors[0].pid.unwrap(), Signal::ABORT);
    running::wait(events, "a", MemberState::Restarting);
}

#[test]
fn simulated_time_stands_while_a_program_is_held() {
    let up = Up::start(&processors("writer", HELD), SIMULATED);
    hold(&up);
    let clock = || up.status().clock.unwrap();
    // It may have been held without having the turn, which it gets in time.
    until(|| clock().waits_for == "`a`, which is held for a debugger");
    let seconds = clock().seconds;
    up.run(&["restart", "a"]);
    until(|| clock().seconds > seconds);
    hold(&up);
    up.run(&["down"]);
    assert_eq!(up.end().0, Some(1));
}

#[test]
fn a_program_is_started_for_a_debugger() {
    for options in [&[][..], SIMULATED] {
        let up = Up::start(&processors("writer", ""), options);
        // It attaches to nothing, but has the program go on.
        let debugger = up.path("debugger");
        let script = "#!/bin/sh\ntest \"$1\" = --version || grep -q '^State:.T' /proc/$2/status && kill -CONT $2\n";
        std::fs::write(&debugger, script).unwrap();
        std::fs::set_permissions(&debugger, PermissionsExt::from_mode(0o755)).unwrap();
        let before = up.status().processors[0].pid;
        let events = up.events();
        up.run(&["gdb", "a", "--start", "--gdb", debugger.to_str().unwrap()]);
        running::wait(events, "a", MemberState::Running);
        let after = up.status().processors[0].clone();
        assert_ne!(after.pid, before);
        // The start after that one is an ordinary one.
        up.run(&["restart", "a"]);
        assert_eq!(up.status().processors[0].state, MemberState::Running);
        let refused = up.command(&["gdb", "files", "--start"]).output().unwrap();
        assert!(text(&refused).contains("no processor"), "{refused:?}");
    }
}

#[test]
fn arithmetic_without_a_result_is_fatal_if_the_description_says_so() {
    let said = "a: processor 0: the servo loop `divide` has raised a floating-point exception: an invalid operation";
    for options in [&[][..], SIMULATED] {
        let keys = "float_exceptions = true\non_failure = \"leave\"\n";
        let up = Up::launch(&processors("divider", keys), options, |_| {});
        up.wait_until_told(said);
        up.wait_until_told("killed by SIGFPE");
    }
    let keys = format!("float_exceptions = true\n{HELD}");
    let up = Up::launch(&processors("divider", &keys), &[], |_| {});
    up.wait_until_told(said);
    up.wait_until_told("a: is held for a debugger");
}

#[test]
fn arithmetic_without_a_result_is_ignored_if_the_description_says_nothing() {
    let up = Up::start(&processors("divider", ""), &[]);
    let before = up.status().processors[0].clone();
    let runs = || {
        let top = text(&up.run(&["top", "--once", "--every", "1ms", "--json"]));
        let top: serde_json::Value = serde_json::from_str(&top).unwrap();
        top["loops"][0]["runs"].as_u64()
    };
    until(|| runs().is_some_and(|runs| runs > 3));
    assert_eq!(up.status().processors[0], before);
}

#[test]
fn a_panic_of_a_loop_stops_the_process_before_the_loop_is_disabled() {
    let up = Up::launch(&processors("divider panics", HELD), &[], |_| {});
    up.wait_until_told("this loop has no divisor");
    up.wait_until_told("a: is held for a debugger");
    let member = up.status().processors[0].clone();
    signal(member.pid.unwrap(), Signal::CONT);
    up.wait_until_told("a: is not held any more");
    until(|| text(&up.run(&["top", "--once", "--every", "1ms"])).contains("faulted"));
    assert_eq!(up.status().processors[0].pid, member.pid);
}
