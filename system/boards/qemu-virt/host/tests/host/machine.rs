//! Harts as processors of a supervisor, with a thread in place of each hart and a pair of sockets in
//! place of the serial line.

use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use condor_clock::{Handover, Page, Until};
use condor_host::supervisor::{Exit, Launch, LaunchError, ProgramImage, RunState, StopMethod};
use condor_mbox::linux::{Claim, LinuxDoorbell};
use condor_mbox::{Clock, Doorbell, MemoryWindow, Processor};
use condor_rt::linux::{Bells, Environment, MappedPage};
use condor_rt::numbers::{PROCESSORS, SUPERVISOR};
use qemu_virt_host::service::Bridge;
use qemu_virt_host::{
    ARGUMENT_BYTES, HartFault, HartLauncher, HartState, MachineMemory, Map, Power, RAM,
};

use crate::elf;

const NUMBER: Processor = Processor(5);
const HART: u32 = 1;
const DEADLINE: Duration = Duration::from_secs(60);

struct Rig {
    directory: tempfile::TempDir,
    memory: MachineMemory,
    power: Power,
    hart: HartLauncher,
    supervisor: Claim<PROCESSORS>,
    bridge: Option<Bridge>,
    /// The machine's end of the line.
    line: UnixStream,
    monitor: Option<JoinHandle<Vec<u8>>>,
}

impl Rig {
    fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let map = Map::new(16 << 20, &[0, NUMBER.0], 4096, 4096, 0).unwrap();
        let memory = MachineMemory::create(directory.path().join("memory"), &map).unwrap();
        let system = memory.system(&directory.path().join("mailbox")).unwrap();
        let supervisor = system.claim(SUPERVISOR).unwrap();
        let harts = [Processor(0), NUMBER].map(|number| {
            let doorbell = system.claim(number).unwrap().doorbell().clone();
            (number, doorbell)
        });
        let (ours, line) = UnixStream::pair().unwrap();
        let page = MappedPage::map(&memory.clock().unwrap()).unwrap();
        let bridge = Some(Bridge::start(ours, harts.to_vec(), Some(page)).unwrap());
        let power = Power::new();
        let doorbell = supervisor.doorbell().clone();
        let hart = HartLauncher::new(memory.clone(), HART, doorbell, power.clone()).unwrap();
        Self {
            directory,
            memory,
            power,
            hart,
            supervisor,
            bridge,
            line,
            monitor: None,
        }
    }

    fn switch_on(&mut self) {
        self.power.switch(true);
        let (memory, line) = (self.memory.clone(), self.line.try_clone().unwrap());
        memory.control(HART).unwrap().wait().unwrap();
        self.monitor = Some(std::thread::spawn(move || monitor(&memory, line)));
    }

    fn image(&self, arguments: &[&str]) -> ProgramImage {
        let file = self.directory.path().join("program.elf");
        std::fs::write(&file, elf::File::pie().build()).unwrap();
        let environment = Environment::new(PathBuf::new(), 4096, NUMBER);
        let arguments = arguments.iter().map(|&one| one.into()).collect();
        ProgramImage::new(file, arguments, environment)
    }

    fn run(&mut self, arguments: &[&str]) {
        let image = self.image(arguments);
        self.hart.load(&image).unwrap();
        self.hart.start().unwrap();
    }

    fn exit(&mut self) -> Exit {
        let begun = Instant::now();
        loop {
            assert!(begun.elapsed() < DEADLINE, "it does not end");
            match self.hart.state() {
                RunState::Ended(exit) => return exit,
                RunState::Runs => std::thread::sleep(Duration::from_millis(1)),
                RunState::Idle => panic!("nothing was started"),
            }
        }
    }

    fn until_it_runs(&self) {
        let control = self.memory.control(HART).unwrap();
        let begun = Instant::now();
        while !matches!(control.state(), Ok(HartState::Runs { .. })) {
            assert!(begun.elapsed() < DEADLINE, "it is not started");
            std::thread::yield_now();
        }
    }

    /// Ends the monitor; what the host has sent on the line.
    fn end(mut self) -> Vec<u8> {
        self.line.shutdown(Shutdown::Both).unwrap();
        self.bridge.take();
        self.monitor.take().unwrap().join().unwrap()
    }
}

/// Does what the monitor of a hart and its program do, whenever the line rings the hart.
fn monitor(memory: &MachineMemory, mut line: UnixStream) -> Vec<u8> {
    let control = memory.control(HART).unwrap();
    let (mut heard, mut byte, mut is_deaf) = (Vec::new(), [0], false);
    while let Ok(1) = line.read(&mut byte) {
        heard.push(byte[0]);
        if byte[0] != NUMBER.0 || is_deaf {
            continue;
        }
        if let Some((start, entry)) = control.wanted().unwrap() {
            control.begin(start).unwrap();
            let mut code = [0; 8];
            memory.region().read(entry, &mut code).unwrap();
            assert_eq!(u64::from_le_bytes(code), elf::CODE, "what is to run");
            let mut arguments = [0; ARGUMENT_BYTES];
            let len = control.arguments(&mut arguments).unwrap();
            match &arguments[..len] {
                b"end\x007\0" => control.end(7).unwrap(),
                b"fault\0" => {
                    let mut fault = HartFault {
                        cause: 5,
                        pc: RAM + u64::from(entry) + 2,
                        value: 0x1000_0000,
                        ..HartFault::default()
                    };
                    fault.registers[1] = 0x8100_0000;
                    control.set_fault(&fault).unwrap();
                    control.fail().unwrap();
                }
                b"deaf\0" => is_deaf = true,
                _ => {}
            }
            // It rings the supervisor, and somebody who does not exist.
            // The test may have seen enough, and have closed the line.
            if line.write_all(&[200, SUPERVISOR.0]).is_err() {
                break;
            }
        } else if matches!(control.state(), Ok(HartState::Runs { .. })) {
            if control.is_abandoned().unwrap() {
                control.leave().unwrap();
            } else if control.is_asked_to_end().unwrap() {
                control.end(0).unwrap();
            }
        }
    }
    heard
}

/// Waits until `doorbell` is rung after `seen`.
fn rung(doorbell: &LinuxDoorbell<PROCESSORS>, seen: u32) {
    let begun = Instant::now();
    while doorbell.prepare() == seen {
        assert!(begun.elapsed() < DEADLINE, "nobody rings");
        doorbell.wait(seen, doorbell.now().after(Duration::from_secs(1)), None);
    }
}

#[test]
fn a_program_is_started_stopped_and_replaced() {
    let mut rig = Rig::new();
    let image = rig.image(&["wait"]);
    assert!(matches!(rig.hart.start(), Err(LaunchError::NotLoaded)));
    rig.hart.load(&image).unwrap();
    assert!(!rig.hart.is_ready());
    let refused = rig.hart.start().unwrap_err().to_string();
    let expected = format!("its machine is not running, or its hart {HART} has not started yet");
    assert_eq!(refused, expected);
    rig.switch_on();
    assert!(rig.hart.is_ready());
    let supervisor = rig.supervisor.doorbell().clone();
    let seen = supervisor.prepare();
    rig.hart.start().unwrap();
    rung(&supervisor, seen);
    assert_eq!(rig.hart.state(), RunState::Runs);
    assert!(matches!(rig.hart.load(&image), Err(LaunchError::Runs)));
    assert!(matches!(rig.hart.start(), Err(LaunchError::Runs)));
    rig.hart.stop(StopMethod::Ask).unwrap();
    assert_eq!(rig.exit(), Exit::Status(0));

    rig.run(&["end", "7"]);
    assert_eq!(rig.exit(), Exit::Status(7));
    rig.run(&["wait"]);
    rig.until_it_runs();
    rig.hart.stop(StopMethod::Force).unwrap();
    let how = "killed; its hart can run another program";
    assert_eq!(rig.exit(), Exit::Other(how.into()));
    // As it was before: what it changed in its data is not there any more.
    let data = rig.memory.map().programs.at(HART) + elf::OBJECT as u32;
    rig.memory.region().write(data, &[9; 8]).unwrap();
    rig.hart.start().unwrap();
    rig.until_it_runs();
    assert_eq!(rig.memory.region().word(data), Ok(0x1234));
    assert_eq!(rig.hart.state(), RunState::Runs, "it was abandoned before");
    let heard = rig.end();
    assert!(
        heard
            .iter()
            .all(|&number| number == NUMBER.0 || number == 0)
    );
}

#[test]
fn a_fault_is_told_with_its_place() {
    let mut rig = Rig::new();
    rig.switch_on();
    rig.run(&["fault"]);
    let exit = rig.exit();
    let pc = RAM + u64::from(rig.memory.map().programs.at(HART)) + elf::ENTRY + 2;
    let expected = format!("load access fault at {pc:#x}, value 0x10000000");
    assert_eq!(exit.to_string(), expected);
    let mut lines = Vec::new();
    rig.hart.output(&mut |line| lines.push(line.to_owned()));
    let linked = format!("(cause 0x5) at {pc:#x} (0x10012 in program.elf), value");
    assert!(lines.len() == 1 && lines[0].contains(&linked), "{lines:?}");
    assert!(lines[0].contains("sp 0x81000000"), "{lines:?}");
    rig.hart.output(&mut |line| panic!("again: {line}"));
    rig.end();
}

#[test]
fn a_hart_that_does_not_come_back_is_given_up() {
    let mut rig = Rig::new();
    rig.switch_on();
    rig.run(&["deaf"]);
    rig.until_it_runs();
    rig.hart.stop(StopMethod::Ask).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(rig.hart.state(), RunState::Runs);
    rig.hart.stop(StopMethod::Force).unwrap();
    let exit = rig.exit().to_string();
    assert!(exit.starts_with("its hart no longer answers"), "{exit}");
    assert!(matches!(rig.hart.start(), Err(LaunchError::Runs)));
    rig.end();
}

#[test]
fn what_runs_ends_with_its_machine() {
    let mut rig = Rig::new();
    rig.switch_on();
    rig.run(&["wait"]);
    rig.until_it_runs();
    rig.power.switch(false);
    assert_eq!(rig.exit(), Exit::Lost);
    assert!(!rig.hart.is_ready());
    rig.memory.reset().unwrap();
    rig.power.switch(true);
    assert!(!rig.hart.is_ready(), "it has not come up");
    rig.memory.control(HART).unwrap().wait().unwrap();
    assert!(rig.hart.is_ready());
    rig.hart.start().unwrap();
    rig.until_it_runs();
    // Off and on between two looks.
    rig.power.switch(true);
    assert_eq!(rig.exit(), Exit::Lost);
    rig.end();
}

#[test]
fn what_a_hart_cannot_run_is_refused() {
    let mut rig = Rig::new();
    let mut image = rig.image(&["wait"]);
    image.arguments = vec!["a".repeat(ARGUMENT_BYTES)];
    let error = rig.hart.load(&image).unwrap_err();
    let expected = format!("the arguments need {} bytes", ARGUMENT_BYTES + 1);
    assert!(error.to_string().starts_with(&expected), "{error}");
    image.arguments = vec!["a".repeat(ARGUMENT_BYTES - 1)];
    rig.hart.load(&image).unwrap();
    std::fs::write(&image.file, "#!/bin/sh").unwrap();
    let error = rig.hart.load(&image).unwrap_err().to_string();
    assert!(
        error.contains("program.elf\": it is not an ELF file"),
        "{error}"
    );
    image.file = "/nowhere".into();
    let error = rig.hart.load(&image).unwrap_err().to_string();
    assert!(error.contains("cannot read \"/nowhere\""), "{error}");
    let doorbell = rig.supervisor.doorbell().clone();
    let error = HartLauncher::new(rig.memory.clone(), 2, doorbell, Power::new()).unwrap_err();
    assert_eq!(error.to_string(), "there is no hart 2: the machine has 2");
}

/// Hands the turn over as a hart does, at the machine's end of the line.
struct OnLine(UnixStream);

impl Handover for OnLine {
    fn sleep(&self, word: &AtomicU32, seen: u32, _: u64) {
        if word.load(Ordering::Acquire) == seen {
            (&self.0).read_exact(&mut [0]).expect("nobody rings");
        }
    }

    fn wake(&self, number: u8, _: &AtomicU32) {
        (&self.0).write_all(&[number]).unwrap();
    }
}

/// Never looks by itself.
struct Patient(Bells);

impl Handover for Patient {
    fn sleep(&self, word: &AtomicU32, seen: u32, _: u64) {
        let begun = Instant::now();
        self.0.sleep(word, seen, DEADLINE.as_nanos() as u64);
        assert!(begun.elapsed() < DEADLINE, "nobody wakes");
    }

    fn wake(&self, number: u8, word: &AtomicU32) {
        self.0.wake(number, word);
    }
}

type Order = Mutex<Vec<(u64, u8)>>;

fn take_turns(page: &Page, me: u8, by: &impl Handover, order: &Order) {
    page.announce(me, 0);
    page.kick(me, by);
    page.first_turn(me, by);
    for at in 1..=TURNS {
        let now = page.turn(me, at, Until::Instant, by);
        order.lock().unwrap().push((now, me));
    }
    page.leave(me, by);
}

const TURNS: u64 = 50;

#[test]
fn a_turn_passes_over_the_line_both_ways() {
    const PROCESS: u8 = 3;
    let rig = Rig::new();
    let page = MappedPage::map(&rig.memory.clock().unwrap()).unwrap();
    page.reset(1 << PROCESS | 1 << NUMBER.0);
    page.set_far(NUMBER.0, true);
    let doorbell = rig.supervisor.doorbell().clone();
    let line = rig.line.try_clone().unwrap();
    line.set_read_timeout(Some(DEADLINE)).unwrap();
    let order = Order::default();
    std::thread::scope(|scope| {
        scope.spawn(|| take_turns(&page, NUMBER.0, &OnLine(line), &order));
        let by = Patient(Bells::new(page.clone(), doorbell));
        take_turns(&page, PROCESS, &by, &order);
    });
    let both = |at| [(at, PROCESS), (at, NUMBER.0)];
    let expected: Vec<_> = (1..=TURNS).flat_map(both).collect();
    assert_eq!(order.into_inner().unwrap(), expected);
}
