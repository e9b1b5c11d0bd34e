//! Real GDB on harts that run.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::{ControlRequest, MemberState};

use crate::running::{DRILLS, Up};

const NEEDS: &str = "the images of tests/firmware";

/// Starts a system with two harts that run the program `debugged`.
pub(crate) fn up(keys: &str) -> Up {
    up_with("", keys)
}

fn up_with(system: &str, keys: &str) -> Up {
    described(system, "", "debugged", keys)
}

pub(crate) fn described(system: &str, machine: &str, program: &str, keys: &str) -> Up {
    let image = crate::running::image("drills-hart");
    let processors = [(1, "one", 0), (2, "two", 1)].map(|(number, name, hart)| {
        format!(
            "[[processors]]\nnumber = {number}\nname = \"{name}\"\nkind = \"hart\"\nhart = {hart}\n\
             program = {image:?}\narguments = [\"{program}\"]\n{keys}"
        )
    });
    let processors = format!("{machine}{}", processors.concat());
    Up::prepared(DRILLS.as_ref(), system, &processors, NEEDS, |_| {})
}

/// Starts GDB with a script on a processor.
pub(crate) fn start(up: &Up, arguments: &[&str], script: &str) -> (Child, tempfile::NamedTempFile) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    let settings = "set pagination off\nset confirm off\nset width 0\n";
    write!(file, "{settings}{script}").unwrap();
    let child = Command::new(DRILLS)
        .env("XDG_RUNTIME_DIR", up.place())
        .arg("gdb")
        .args(arguments)
        .args(["--", "-nx", "-batch", "-x"])
        .arg(file.path())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    (child, file)
}

/// Has GDB run a script on a processor, and returns what it prints.
pub(crate) fn gdb(up: &Up, arguments: &[&str], script: &str) -> String {
    let (child, _file) = start(up, arguments, script);
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}{errors}");
    text + &errors
}

/// Checks that parts come in a text one after the other.
pub(crate) fn contains(text: &str, parts: &[&str]) {
    let mut rest = text;
    for part in parts {
        let place = rest.find(part);
        let place = place.unwrap_or_else(|| panic!("no {part:?} in its place:\n{text}"));
        rest = &rest[place + part.len()..];
    }
}

/// Waits until both run, and neither has been started again.
pub(crate) fn both_run(up: &Up) {
    up.wait_for("one", MemberState::Running);
    up.wait_for("two", MemberState::Running);
    for name in ["one", "two"] {
        assert_eq!(up.member(name).restarts, 0, "{name}");
    }
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_debugger_attaches_breaks_steps_changes_and_leaves() {
    let up = up("");
    let seen = gdb(
        &up,
        &["one"],
        "break drills_hart::debugged::torque\n\
         continue\n\
         print error.data\n\
         next\n\
         print gain\n\
         step\n\
         backtrace -frame-info short-location 3\n\
         finish\n\
         finish\n\
         delete\n\
         tbreak drills_hart::debugged::wait_for_fast\n\
         continue\n\
         tbreak drills_hart::debugged::torque\n\
         continue\n\
         backtrace -frame-info short-location 60\n\
         print drills_hart::debugged::WATCHED.gain.v.value = 0x40400000\n\
         tbreak drills_hart::debugged::scale\n\
         continue\n\
         info args\n\
         monitor statistics\n\
         detach\n",
    );
    contains(
        &seen,
        &[
            "Breakpoint 1, drills_hart::debugged::torque",
            "([[1, 2, ",
            "let scaled = scale(error, gain);",
            " = 2\n",
            "drills_hart::debugged::scale (error=..., gain=2)",
            "drills_hart::debugged::torque",
            // Out of what is inlined in `scale`, and out of `scale`.
            "drills_hart::debugged::scale (error=..., gain=2) at",
            "drills_hart::debugged::torque (error=...) at",
            "drills_hart::debugged::wait_for_fast",
            // The faster loop, in the slower one, in the background.
            "drills_hart::debugged::torque",
            "qemu_virt_board::trap::condor_timer",
            "<signal handler called>",
            "drills_hart::debugged::wait_for_fast",
            "qemu_virt_board::trap::condor_timer",
            "<signal handler called>",
            "condor_rt::running::Background",
            "gain=3",
            "detached",
        ],
    );
    contains(&seen, &["hart 0, processor 1: stopped"]);
    both_run(&up);
    // Again, by Ctrl-C, while the other hart runs.
    let seen = gdb(
        &up,
        &["one"],
        "python import threading, os, signal\n\
         python threading.Timer(1, lambda: os.kill(os.getpid(), signal.SIGINT)).start()\n\
         continue\n\
         print/f drills_hart::debugged::WATCHED.gain.v.value\n\
         detach\n",
    );
    contains(&seen, &["received signal SIGINT", " = 3\n", "detached"]);
    both_run(&up);
    gdb(&up, &["one"], "kill\n");
    up.wait_for("one", MemberState::Stopped);
    assert_eq!(up.member("two").state, MemberState::Running);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn triggers_stop_at_a_store_and_at_an_instruction() {
    let up = up("");
    let seen = gdb(
        &up,
        &["one"],
        "watch drills_hart::debugged::WATCHED.slow.v.value\n\
         continue\n\
         continue\n\
         delete\n\
         rwatch drills_hart::debugged::WATCHED.gain.v.value\n\
         watch drills_hart::debugged::WATCHED.faults.v.value\n\
         continue\n\
         delete\n\
         hbreak drills_hart::debugged::torque\n\
         continue\n\
         monitor statistics\n\
         hbreak drills_hart::debugged::scale\n\
         hbreak drills_hart::debugged::wait_for_fast\n\
         continue\n",
    );
    contains(
        &seen,
        &[
            "Hardware watchpoint 1: ",
            "Hardware watchpoint 1: ",
            "Old value = ",
            "New value = ",
            "Hardware watchpoint 1: ",
            "Old value = ",
            "New value = ",
            "Hardware read watchpoint 2: ",
            "Hardware watchpoint 3: ",
            "Hardware read watchpoint 2: ",
            "Value = 1073741824",
            "drills_hart::debugged::torque",
            "Hardware assisted breakpoint 4",
            "Breakpoint 4, drills_hart::debugged::torque",
        ],
    );
    contains(&seen, &["; 1 breakpoints are set"]);
    // The machine has two triggers.
    contains(&seen, &["Cannot insert hardware breakpoint"]);
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn two_processors_are_threads_of_one_session() {
    let up = up("");
    let seen = gdb(
        &up,
        &["one", "two"],
        "info threads\n\
         tbreak drills_hart::debugged::torque\n\
         continue\n\
         thread 2\n\
         print $pc != 0\n\
         set scheduler-locking on\n\
         tbreak drills_hart::debugged::scale\n\
         continue\n\
         thread\n\
         print gain\n\
         monitor reset\n\
         monitor statistics\n\
         detach\n",
    );
    contains(
        &seen,
        &[
            "a program cannot be started while several processors are debugged",
            "one, hart 0, processor 1: stopped",
            "two, hart 1, processor 2: stopped",
        ],
    );
    contains(
        &seen,
        &[
            "\"one, hart 0, processor 1\"",
            "\"two, hart 1, processor 2\"",
            "(2 locations)",
            "hit Temporary breakpoint 1.",
            "[Switching to thread 2",
            " = true",
            "hit Temporary breakpoint 2.",
            "[Current thread is 2 ",
            " = 2",
            "detached",
        ],
    );
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_fatal_exception_waits_for_a_debugger_while_others_go_on() {
    let up = up("hold_exceptions = true\n");
    // Attached.
    let script = "print drills_hart::debugged::WATCHED.faults.v.value = 1\n\
                  continue\n\
                  monitor trap\n\
                  detach\n";
    let seen = gdb(&up, &["one"], script);
    contains(&seen, &["received signal SIGILL", "detached"]);
    contains(&seen, &["cause 0x2"]);
    // Nobody is attached now: it makes the trap again, and stands.
    up.wait_for("one", MemberState::Held);
    assert_eq!(up.member("two").state, MemberState::Running);
    let seen = gdb(
        &up,
        &["one"],
        "backtrace 1\n\
         print drills_hart::debugged::WATCHED.faults.v.value = 0\n\
         print $pc = $pc + 2\n\
         detach\n",
    );
    contains(&seen, &["debugged.rs", "detached"]);
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_process_is_debugged_from_its_start_and_goes_on_without_its_debugger() {
    let process = "[[processors]]\nnumber = 3\nname = \"three\"\nprogram = \"self\"\narguments = [\"echo\"]\n";
    let up = described("", process, "debugged", "");
    let before = up.member("three").pid;
    let start = ["three", "--start", "--gdb", "gdb-multiarch"];
    let seen = gdb(
        &up,
        &start,
        "tbreak pthread_create\n\
         continue\n\
         backtrace 1\n\
         detach\n",
    );
    contains(
        &seen,
        &["Temporary breakpoint 1, ", "pthread_create", "detached"],
    );
    up.wait_for("three", MemberState::Running);
    let after = up.member("three");
    assert_ne!(after.pid, before);
    assert_eq!(after.restarts, 0);
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_handler_of_interrupts_is_stepped_through() {
    let up = up("");
    // From before it has saved the interrupted state until after it has restored it.
    let seen = gdb(
        &up,
        &["one"],
        "break qemu_virt_board::trap::condor_timer\n\
         continue\n\
         python\n\
         for _ in range(20): gdb.execute(\"stepi\", to_string=True)\n\
         end\n\
         delete\n\
         tbreak *(qemu_virt_board::trap::condor_timer + 2)\n\
         continue\n\
         next\n\
         next\n\
         print $pc = $pc\n\
         delete\n\
         tbreak drills_hart::debugged::torque\n\
         continue\n\
         detach\n",
    );
    contains(
        &seen,
        &[
            "qemu_virt_board::trap::condor_timer",
            "drills_hart::debugged::torque",
            "detached",
        ],
    );
    // No step leads out of it into the trap entry, and none is tried again.
    let seen = gdb(
        &up,
        &["one"],
        "tbreak qemu_virt_board::trap::condor_timer\n\
         continue\n\
         python\n\
         frame = gdb.selected_frame()\n\
         block = frame.block()\n\
         while not block.function: block = block.superblock\n\
         for it in frame.architecture().disassemble(block.start, block.end - 1):\n\
         \x20if it[\"asm\"] == \"ret\": gdb.execute(\"break *%#x\" % it[\"addr\"])\n\
         end\n\
         continue\n\
         stepi\n\
         step\n\
         delete\n\
         tbreak drills_hart::debugged::torque\n\
         continue\n\
         detach\n",
    );
    let signal = "received signal SIGINT";
    let after = [signal, signal, "drills_hart::debugged::torque", "detached"];
    contains(&seen, &after);
    contains(&seen, &["cannot step from here", "cannot step from here"]);
    // The trap entry itself is no place for a breakpoint.
    let script = "set language c\ntbreak *&condor_trap_entry\ncontinue\ndetach\n";
    contains(&gdb(&up, &["one"], script), &["Cannot insert breakpoint"]);
    both_run(&up);
    let before = print(&up, &["one", "WATCHED.fast"]);
    let begun = Instant::now();
    while print(&up, &["one", "WATCHED.fast"]) == before {
        assert!(begun.elapsed() < Duration::from_secs(60), "loops stand");
    }
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn programs_are_started_with_a_debugger_and_from_it() {
    let up = up("");
    let seen = gdb(
        &up,
        &["two", "--start"],
        "print drills_hart::debugged::WATCHED.fast.v.value\n\
         break drills_hart::main\n\
         continue\n\
         delete\n\
         tbreak drills_hart::debugged::torque\n\
         continue\n\
         print drills_hart::debugged::WATCHED.fast.v.value\n\
         detach\n",
    );
    contains(
        &seen,
        &[
            " = 0\n",
            "drills_hart::main (",
            "drills_hart::debugged::torque",
            " = 0\n",
            "detached",
        ],
    );
    let image = crate::running::image("drills-hart");
    let again = "maintenance flush register-cache\n\
         print drills_hart::debugged::WATCHED.slow.v.value\n\
         continue\n\
         print drills_hart::debugged::WATCHED.slow.v.value > 0\n";
    let seen = gdb(
        &up,
        &["one"],
        &format!(
            "monitor vectors\n\
             break drills_hart::debugged::torque if drills_hart::debugged::WATCHED.slow.v.value > 0\n\
             continue\n\
             monitor reset\n\
             {again}\
             monitor load /none-such\n\
             stepi\n\
             monitor load {image} debugged\n\
             {again}\
             monitor reset now\n\
             delete\n\
             detach\n"
        ),
    );
    let starts = [" = 0\n", "torque", " = true\n"];
    contains(&seen, &[&starts[..], &starts[..], &["detached"]].concat());
    // What GDB is told comes apart from what it prints.
    contains(
        &seen,
        &[
            "processor  vector",
            "one, hart 0, processor 1: stopped at",
            "one, hart 0, processor 1: cannot read",
            "one, hart 0, processor 1: stopped at",
            "there is no command `reset now`",
            "monitor load FILE",
        ],
    );
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn what_the_stub_calls_may_have_breakpoints() {
    let up = up("");
    // The copy of memory, the stub itself, and the program: only the last one stops, and by a step goes on.
    let seen = gdb(
        &up,
        &["one"],
        "set language c\n\
         break *&memcpy\n\
         break *&condor_exception\n\
         break *&condor_software\n\
         set language rust\n\
         break drills_hart::debugged::torque\n\
         python\n\
         for _ in range(40):\n\
         \x20gdb.execute(\"continue\", to_string=True)\n\
         \x20gdb.execute(\"stepi\", to_string=True)\n\
         end\n\
         info breakpoints\n\
         delete\n\
         tbreak drills_hart::debugged::torque\n\
         continue\n\
         detach\n",
    );
    contains(
        &seen,
        &[
            "qemu_virt_board::debug::condor_exception",
            "breakpoint already hit",
            "drills_hart::debugged::torque",
            "detached",
        ],
    );
    both_run(&up);
}

/// Returns the text that `print` prints of a processor, and true if it succeeds.
fn print(up: &Up, arguments: &[&str]) -> (bool, String) {
    let output = Command::new(DRILLS)
        .env("XDG_RUNTIME_DIR", up.place())
        .arg("print")
        .args(arguments)
        .output()
        .unwrap();
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    (output.status.success(), text)
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn variables_are_read_by_name_while_loops_run() {
    let up = up("");
    let watched = |number: &str| {
        let (printed, text) = print(&up, &[number, "WATCHED", "debugged::WATCHED.fast"]);
        assert!(printed, "{text}");
        contains(
            &text,
            &[
                "WATCHED = {gain: 1073741824, fast: ",
                ", slow: ",
                ", faults: 0}\n",
                "debugged::WATCHED.fast = ",
            ],
        );
        let (_, count) = text.trim_end().rsplit_once(' ').unwrap();
        count.parse::<u32>().unwrap()
    };
    let before = [watched("one"), watched("two")];
    let begun = Instant::now();
    while watched("one") <= before[0] || watched("two") <= before[1] {
        assert!(begun.elapsed() < Duration::from_secs(60), "loops stand");
    }
    // Written while the loops run.
    let (printed, text) = print(
        &up,
        &["two", "WATCHED.slow=1000000", "WATCHED.gain = 0x40400000"],
    );
    assert!(printed, "{text}");
    contains(&text, &["WATCHED.slow = 10", "WATCHED.gain = 1077936128"]);
    let (_, text) = print(&up, &["two", "WATCHED.slow"]);
    contains(&text, &["WATCHED.slow = 10"]);
    for (expression, told) in [
        ("WATCHED.faults=256", "`WATCHED.faults` cannot be `256`"),
        (
            "WATCHED=1",
            "`WATCHED`: it is not a number that occupies whole bytes",
        ),
        ("WATCHER", "there is no static variable `WATCHER`"),
        (
            "WATCHED.slower",
            "has no part `.slower`; it has gain, fast, slow, faults",
        ),
        ("WATCHED[1]", "has no part `[1]`"),
        ("WATCHED..", "is not an expression"),
    ] {
        let (printed, text) = print(&up, &["one", expression]);
        assert!(!printed, "{text}");
        contains(&text, &[told]);
    }
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn numbers_of_programs_are_plotted_by_expressions() {
    let up = up("");
    let plot = |name: &str| {
        let line = format!("stty rows 24 cols 80; exec {DRILLS} plot {name}");
        Command::new("script")
            .env("XDG_RUNTIME_DIR", up.place())
            .env("TERM", "xterm")
            .args(["-qec", &line, "/dev/null"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap()
    };
    let refused = plot("one:WATCHED.fats").wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&refused.stdout).into_owned();
    contains(&text, &["has no part `.fats`"]);
    let mut shown = plot("one:WATCHED.fast");
    let mut output = shown.stdout.take().unwrap();
    let (mut seen, mut piece) = (Vec::new(), [0; 4096]);
    // Its name, and then its curve, of dots of Braille.
    let is_drawn = |seen: &[u8]| {
        let text = String::from_utf8_lossy(seen).into_owned();
        let drawn = text
            .chars()
            .filter(|it| ('\u{2801}'..='\u{28ff}').contains(it))
            .count();
        text.contains("WATCHED.fast") && drawn > 20
    };
    while !is_drawn(&seen) {
        let count = output.read(&mut piece).unwrap();
        assert!(count > 0, "{}", String::from_utf8_lossy(&seen));
        seen.extend_from_slice(&piece[..count]);
    }
    shown.stdin.take().unwrap().write_all(b"q").unwrap();
    std::io::copy(&mut output, &mut std::io::sink()).unwrap();
    shown.wait().unwrap();
    both_run(&up);
}

/// Starts a gateway, which a debugger has stop the program of a processor. The program is held as long as
/// both live.
fn held(up: &Up, name: &str) -> (Child, UnixStream) {
    let mut gateway = Command::new(DRILLS)
        .env("XDG_RUNTIME_DIR", up.place())
        .args(["debug", name])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let output = gateway.stdout.take().unwrap();
    BufReader::new(output).read_line(&mut line).unwrap();
    let (_, socket) = line
        .trim_end()
        .trim_end_matches('\'')
        .split_once("remote ")
        .unwrap();
    assert_eq!(std::fs::metadata(socket).unwrap().mode() & 0o777, 0o600);
    let mut debugger = UnixStream::connect(socket).unwrap();
    debugger.write_all(b"+$?#3f").unwrap();
    up.wait_for(name, MemberState::Held);
    (gateway, debugger)
}

/// Sends a packet, and returns the answer.
fn answer(debugger: &mut UnixStream, packet: &str) -> String {
    let sum = packet.bytes().fold(0_u8, u8::wrapping_add);
    write!(debugger, "${packet}#{sum:02x}").unwrap();
    let (mut all, mut byte) = (Vec::new(), [0]);
    while all.last() != Some(&b'#') {
        debugger.read_exact(&mut byte).unwrap();
        all.push(byte[0]);
    }
    debugger.read_exact(&mut [0; 2]).unwrap();
    debugger.write_all(b"+").unwrap();
    let text = String::from_utf8(all).unwrap();
    let (_, answer) = text.trim_end_matches('#').rsplit_once('$').unwrap();
    answer.into()
}

/// Steps a hart as LLDB does.
#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_gateway_steps_by_itself() {
    let up = up("");
    // Where GDB has the function.
    let seen = gdb(
        &up,
        &["one"],
        "info address drills_hart::debugged::torque\n",
    );
    let (_, address) = seen.rsplit_once(" 0x").unwrap();
    let address = address.split('.').next().unwrap();
    let (mut gateway, mut debugger) = held(&up, "one");
    // Of the stop.
    let mut read = [0; 512];
    assert!(debugger.read(&mut read).unwrap() > 0);
    debugger.write_all(b"+").unwrap();
    assert_eq!(answer(&mut debugger, &format!("Z0,{address},2")), "OK");
    let hit = answer(&mut debugger, "c");
    assert_eq!(hit, "T05swbreak:;thread:1;");
    let mut places = std::collections::BTreeSet::new();
    for _ in 0..8 {
        assert_eq!(answer(&mut debugger, "s"), "T05thread:1;");
        places.insert(answer(&mut debugger, "p20"));
    }
    assert_eq!(places.len(), 8, "{places:?}");
    kill(gateway.id());
    gateway.wait().unwrap();
    both_run(&up);
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_held_program_can_be_stopped_by_its_supervisor() {
    let up = up("");
    let (mut gateway, _debugger) = held(&up, "one");
    let processor = || "one".to_owned();
    let stop = ControlRequest::Stop {
        processor: processor(),
    };
    up.client().ask(&stop).unwrap();
    assert_eq!(up.member("one").state, MemberState::Stopped);
    let start = ControlRequest::Start {
        processor: processor(),
    };
    up.client().ask(&start).unwrap();
    both_run(&up);
    kill(gateway.id());
    gateway.wait().unwrap();
}

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_held_processor_stops_simulated_time() {
    let up = up_with("[clock]\nkind = \"simulated\"\n", "");
    let seconds = || up.client().status().unwrap().clock.unwrap().seconds;
    let (mut gateway, _debugger) = held(&up, "one");
    // The others go on until they would be later than the one that stands.
    let begun = Instant::now();
    let mut stands = seconds();
    loop {
        std::thread::sleep(Duration::from_millis(300));
        let now = seconds();
        if now.to_bits() == stands.to_bits() {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "time goes on");
        stands = now;
    }
    kill(gateway.id());
    gateway.wait().unwrap();
    up.wait_for("one", MemberState::Running);
    while seconds() <= stands {
        assert!(begun.elapsed() < Duration::from_secs(120), "time stands");
        std::thread::sleep(Duration::from_millis(10));
    }
    both_run(&up);
}

/// Kills a process, which may have ended by itself.
pub(crate) fn kill(pid: u32) {
    let _ = Command::new("kill")
        .args(["-KILL", &pid.to_string()])
        .stderr(Stdio::null())
        .status();
}
