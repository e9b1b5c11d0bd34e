//! What debuggers cost the loops of harts, in a machine whose time counts instructions.

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use condor_debug::{Breakpoint, ProgramState, Tracer};
use condor_host::view::{LoopRates, View};
use condor_mbox::Processor;
use qemu_virt_host::MachineMemory;

use crate::debugger::{both_run, contains, described, gdb, kill, start};
use crate::running::{DRILLS, Up};

/// Starts a system in a machine whose time counts instructions: a release that a loop skips is not the
/// fault of a busy computer. Each instruction takes 1 ns; a hart that was held goes through all that was
/// due meanwhile, which keeps the others from their turns.
fn up_exactly() -> Up {
    let options = "options = [\"-icount\", \"shift=0,sleep=off\"]\n";
    described("", options, "debugged-alone", "")
}

fn view(up: &Up) -> View {
    let window_bytes = up.client().status().unwrap().window_bytes;
    View::open(&up.directory(), window_bytes).unwrap()
}

/// Returns the number of releases that the loops of a processor have had, and the number that they have
/// skipped.
fn releases(up: &Up, number: u8) -> [u64; 2] {
    let loops = view(up).loops(Processor(number)).unwrap().overall();
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

/// Returns the number in a variable of the environment, or `default`.
pub(crate) fn number<T: std::str::FromStr<Err: std::fmt::Debug>>(name: &str, default: T) -> T {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// Returns the processes that a process has started.
fn children(pid: u32) -> Vec<u32> {
    let children = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
    let children = children.unwrap_or_default();
    children.split_whitespace().flat_map(str::parse).collect()
}

/// How often a debugger is killed, and by which random numbers; the figures of system/boards/qemu-virt/README.md
/// are of 200.
const KILLS: u32 = 10;
const SEED: u64 = 0x9e37_79b9_7f4a_7c15;
/// How long after its start at most, in milliseconds.
const LATEST: u64 = 1200;

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
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
        held += u32::from(tracer.state() != Ok(ProgramState::Runs));
        // GDB itself, if it has been started.
        let started = children(gateway);
        match started.first() {
            Some(debugger) if round % 2 == 1 => kill(*debugger),
            _ => kill(gateway),
        }
        output.join().unwrap().unwrap();
        let begun = Instant::now();
        while !tracer.planted().unwrap().is_empty()
            || tracer.state() != Ok(ProgramState::Runs)
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

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn loops_of_a_hart_follow_the_rates_that_people_set() {
    let up = up_exactly();
    let set = |hz: &str| {
        let mut command = Command::new(DRILLS);
        let command = command.env("XDG_RUNTIME_DIR", up.place());
        let set = command.args(["vars", "set", "two:slow.hz", hz]).output();
        set.unwrap()
    };
    let begun = Instant::now();
    // 400 Hz and 33.3 Hz repeat after 10 s, for which no table has room.
    for (hz, rate, computed) in [("20", 20.0, false), ("0", 0.0, false), ("33.3", 33.3, true)] {
        let done = set(hz);
        assert!(done.status.success(), "{done:?}");
        loop {
            let loops = view(&up).loops(Processor(2)).unwrap().overall();
            // While the program publishes them, there is nothing to see.
            let slow = loops.iter().find(|it| it.name == "slow");
            let follows = |slow: &LoopRates| {
                let has_rate = (slow.rate_hz - rate).abs() < 1e-9 && slow.computed == computed;
                slow.enabled != (rate < 1.0) && (has_rate || rate < 1.0)
            };
            if slow.is_some_and(follows) {
                break;
            }
            assert!(begun.elapsed() < Duration::from_secs(600), "{slow:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    let refused = String::from_utf8(set("51").stderr).unwrap();
    assert!(
        refused.contains("must be from 0.0 to 50.0 Hz, not 51.0"),
        "{refused}"
    );
    let [_, before] = releases(&up, 2);
    let [_, skipped] = after(&up, 2, STARTED);
    assert_eq!(skipped, before);
    let loops = view(&up).loops(Processor(2)).unwrap().overall();
    let times = loops.iter().filter_map(|it| it.run_percentiles_us);
    assert!(times.map(|it| it.p50).all(|median| median > 0.0));
    up.end();
}

/// The number of releases after which a processor that was started is not late any more because another one
/// starts.
const STARTED: u64 = 2000;

/// How long a variable is watched, in seconds of 100 reads; the figures of system/boards/qemu-virt/README.md are
/// of 60.
const WATCH: usize = 3;
const READS: usize = 100;

#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
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

/// How often a breakpoint is planted into a running program, and removed.
const PLANTS: u32 = 300;

/// A release that becomes due while the stub works comes later by what is left of that. So the greatest
/// lateness grows to the pause, if there are many.
#[test]
#[ignore = "needs the images of tests/firmware, QEMU and gdb-multiarch"]
fn a_breakpoint_is_planted_between_two_releases() {
    let up = up_exactly();
    let before = after(&up, 1, STARTED);
    let late = |up: &Up| {
        let loops = view(up).loops(Processor(1)).unwrap().overall();
        loops
            .iter()
            .map(|it| it.worst_lateness_us)
            .fold(0.0, f64::max)
    };
    let begun = late(&up);
    let doorbell = view(&up).post().doorbell().doorbell().clone();
    let debuggee = qemu_virt_host::HARTS
        .debuggee(&up.directory(), Processor(1), doorbell)
        .unwrap()
        .unwrap();
    // Between program and stack, where nothing is executed.
    let address = u64::midpoint(debuggee.code.start, debuggee.code.end) & !1;
    for _ in 0..PLANTS {
        debuggee
            .tracer
            .plant(&[Breakpoint::Instruction(address)], false)
            .unwrap();
        debuggee.tracer.plant(&[], false).unwrap();
    }
    let [released, skipped] = after(&up, 1, STARTED);
    println!(
        "{} commands, {} releases: greatest lateness {begun} us before, {} us after",
        2 * PLANTS,
        released - before[0],
        late(&up)
    );
    assert_eq!(skipped, before[1]);
    both_run(&up);
}
