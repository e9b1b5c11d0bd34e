//! Real GDB on harts that run.

use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_debug::{State, Tracer};
use condor_host::control::{MemberState, Request};
use condor_host::view::View;
use condor_mbox::Processor;
use qemu_virt_host::MachineMemory;

use crate::running::{DRILLS, Up};

const NEEDS: &str = "the images of boards/qemu-virt";

/// A system with two harts that run the program `debugged`.
fn up(keys: &str) -> Up {
    up_with("", keys)
}

/// In a machine whose time counts instructions: a release that a loop skips is not the fault of a busy
/// computer. Each takes 1 ns; a hart that was held goes through all that was due meanwhile, which keeps the
/// others from their turns.
fn up_exactly() -> Up {
    let options = "options = [\"-icount\", \"shift=0,sleep=off\"]\n";
    described("", options, "debugged-alone", "")
}

fn up_with(system: &str, keys: &str) -> Up {
    described(system, "", "debugged", keys)
}

fn described(system: &str, machine: &str, program: &str, keys: &str) -> Up {
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

/// How many releases the loops of a processor have had, and how many of them they have skipped.
fn releases(up: &Up, number: u8) -> [u64; 2] {
    let window_bytes = up.client().status().unwrap().window_bytes;
    let view = View::open(&up.directory(), window_bytes).unwrap();
    let loops = view.loops(Processor(number)).unwrap().overall();
    loops.iter().fold([0; 2], |[released, skipped], it| {
        [released + it.runs + it.overruns, skipped + it.overruns]
    })
}

/// Waits until the loops of a processor have had as many releases more, and returns their counts.
fn after(up: &Up, number: u8, count: u64) -> [u64; 2] {
    let begun = Instant::now();
    let before = releases(up, number);
    loop {
        let now = releases(up, number);
        if now[0] >= before[0] + count {
            return now;
        }
        assert!(begun.elapsed() < Duration::from_secs(600), "loops stand");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// The number in a variable of the environment.
fn number<T: std::str::FromStr<Err: std::fmt::Debug>>(name: &str, default: T) -> T {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// Starts GDB with a script on a processor.
fn start(up: &Up, arguments: &[&str], script: &str) -> (Child, tempfile::NamedTempFile) {
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
fn gdb(up: &Up, arguments: &[&str], script: &str) -> String {
    let (child, _file) = start(up, arguments, script);
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}{errors}");
    text + &errors
}

/// Checks that parts come in a text one after the other.
fn contains(text: &str, parts: &[&str]) {
    let mut rest = text;
    for part in parts {
        let place = rest.find(part);
        let place = place.unwrap_or_else(|| panic!("no {part:?} in its place:\n{text}"));
        rest = &rest[place + part.len()..];
    }
}

/// Waits until both run, and neither has been started again.
fn both_run(up: &Up) {
    up.wait_for("one", MemberState::Running);
    up.wait_for("two", MemberState::Running);
    for name in ["one", "two"] {
        assert_eq!(up.member(name).restarts, 0, "{name}");
    }
}

#[test]
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
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
            "board::trap::condor_timer",
            "<signal handler called>",
            "drills_hart::debugged::wait_for_fast",
            "board::trap::condor_timer",
            "<signal handler called>",
            "condor_rt::running::Background",
            "gain=3",
            "detached",
        ],
    );
    contains(&seen, &["hart 0, processor 1: held"]);
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
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
fn a_program_starts_with_a_debugger() {
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
    both_run(&up);
}

#[test]
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
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
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
fn a_handler_of_interrupts_is_stepped_through() {
    let up = up("");
    // From before it has saved the interrupted state until after it has restored it.
    let seen = gdb(
        &up,
        &["one"],
        "break board::trap::condor_timer\n\
         continue\n\
         python\n\
         for _ in range(20): gdb.execute(\"stepi\", to_string=True)\n\
         end\n\
         delete\n\
         tbreak *(board::trap::condor_timer + 2)\n\
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
            "board::trap::condor_timer",
            "drills_hart::debugged::torque",
            "detached",
        ],
    );
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

/// What `print` prints of a processor, and whether it succeeds.
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
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
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
    for (expression, told) in [
        ("WATCHER", "there is no static variable `WATCHER`"),
        (
            "WATCHED.slower",
            "has no part `.slower`; there are gain, fast, slow, faults",
        ),
        ("WATCHED[1]", "has no part `[1]`"),
        ("WATCHED..", "is no expression"),
    ] {
        let (printed, text) = print(&up, &["one", expression]);
        assert!(!printed, "{text}");
        contains(&text, &[told]);
    }
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

#[test]
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
fn a_held_program_can_be_stopped_by_its_supervisor() {
    let up = up("");
    let (mut gateway, _debugger) = held(&up, "one");
    let processor = || "one".to_owned();
    let stop = Request::Stop {
        processor: processor(),
    };
    up.client().ask(&stop).unwrap();
    assert_eq!(up.member("one").state, MemberState::Stopped);
    let start = Request::Start {
        processor: processor(),
    };
    up.client().ask(&start).unwrap();
    both_run(&up);
    kill(gateway.id());
    gateway.wait().unwrap();
}

#[test]
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
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

/// How often a debugger is killed, and by which random numbers; the figures of boards/qemu-virt/README.md
/// are of 200.
const KILLS: u32 = 10;
const SEED: u64 = 0x9e37_79b9_7f4a_7c15;
/// How long after its start at most, in milliseconds.
const LATEST: u64 = 1200;

/// The processes that a process has started.
fn children(pid: u32) -> Vec<u32> {
    let children = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
    let children = children.unwrap_or_default();
    children.split_whitespace().flat_map(str::parse).collect()
}

fn kill(pid: u32) {
    // It may have ended by itself.
    let _ = Command::new("kill")
        .args(["-KILL", &pid.to_string()])
        .stderr(Stdio::null())
        .status();
}

#[test]
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
fn killed_debuggers_leave_programs_as_they_were() {
    let kills = number("CONDOR_KILLS", KILLS);
    let up = up_exactly();
    let before = after(&up, 2, STARTED);
    let memory = MachineMemory::open(up.directory().path().join("memory")).unwrap();
    let area = memory.control(0).unwrap().debug_area().unwrap();
    let tracer = Tracer::new(area, || {});
    // As fast as it goes: breakpoints are planted and removed all the time.
    let script = "break drills_hart::debugged::torque\nwhile 1\nnext\ncontinue\nend\n";
    let (mut random, mut held) = (number("CONDOR_SEED", SEED), 0);
    for round in 0..kills {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        let (child, _file) = start(&up, &["one"], script);
        let gateway = child.id();
        let output = std::thread::spawn(move || child.wait_with_output());
        std::thread::sleep(Duration::from_millis(random % LATEST));
        held += u32::from(tracer.state() != Ok(State::Runs));
        // GDB itself, if it has been started.
        let started = children(gateway);
        match started.first() {
            Some(debugger) if round % 2 == 1 => kill(*debugger),
            _ => kill(gateway),
        }
        output.join().unwrap().unwrap();
        let begun = Instant::now();
        while !tracer.planted().unwrap().is_empty()
            || tracer.state() != Ok(State::Runs)
            || tracer.mode().unwrap().attached
        {
            let limit = Duration::from_secs(60);
            assert!(begun.elapsed() < limit, "round {round} has left something");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
    both_run(&up);
    assert!(held > 0, "no kill came while a program was held");
    let seen = gdb(
        &up,
        &["one"],
        "tbreak drills_hart::debugged::torque\ncontinue\n",
    );
    contains(&seen, &["Temporary breakpoint 1, "]);
    let [released, skipped] = releases(&up, 2);
    println!(
        "{kills} kills, {held} while the program was held; the loops of the other hart: {} releases, {} skipped",
        released - before[0],
        skipped - before[1]
    );
    assert!(released > before[0], "the other hart stands");
    assert_eq!(skipped, before[1], "loops of the other hart have overruns");
}

/// So many releases after it was started, a processor is not late any more because of another one that starts.
const STARTED: u64 = 2000;

/// How long a variable is watched, in seconds of 100 reads; the figures of boards/qemu-virt/README.md are
/// of 60.
const WATCH: usize = 3;
const READS: usize = 100;

#[test]
#[ignore = "needs the images of boards/qemu-virt, QEMU and gdb-multiarch"]
fn a_live_watch_costs_no_release() {
    let reads = READS * number("CONDOR_WATCH", WATCH);
    let up = up_exactly();
    let begun = after(&up, 1, STARTED);
    let mut watch = Command::new(DRILLS)
        .env("XDG_RUNTIME_DIR", up.place())
        .args(["print", "one", "WATCHED.fast", "--every", "10ms"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(watch.stdout.take().unwrap()).lines();
    let value = |line: std::io::Result<String>| {
        let line = line.unwrap();
        let (_, count) = line.rsplit_once(' ').unwrap();
        count.parse::<u32>().unwrap()
    };
    let values: Vec<u32> = lines.take(reads).map(value).collect();
    kill(watch.id());
    watch.wait().unwrap();
    let watched = releases(&up, 1);
    assert_eq!(values.len(), reads);
    assert!(values.is_sorted() && values.first() < values.last());
    // As many releases again, which nobody watches.
    let count = watched[0] - begun[0];
    let alone = after(&up, 1, count);
    let [with, without] = [watched[1] - begun[1], alone[1] - watched[1]];
    println!("{reads} reads in {count} releases: {with} skipped; {without} without them");
    assert!(
        with <= without,
        "{with} releases skipped, {without} without a watch"
    );
    both_run(&up);
}
