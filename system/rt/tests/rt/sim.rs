//! Systems in virtual time.
#![cfg(feature = "sim")]

use std::sync::Mutex;
use std::time::Duration;

use condor_dev::Bus as _;
use condor_dev::linux::{LinuxBus, MapAccess};
use condor_mbox::{
    Call, Clock as _, Doorbell as _, Evidence, Instant, Messenger, Processor, Vector,
};
use condor_mos::{LoopId, Loops, Overrun, Platform, Rate, Timer as _};
use condor_rt::sim::{Cause, SimError, SimFailure, VirtualSystem};
use condor_rt::{Machine, Program, ProgramError, ServoLoop};

const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(100)];
const ADD: Vector = Vector(5);
const SECOND: Duration = Duration::from_secs(1);
const PROGRAMS: u8 = 3;

/// Who, when, what, and a word.
type Event = (u8, u64, &'static str, u32);

/// Loops of two rates, and requests to both neighbours.
struct Talker<'t> {
    trace: &'t Mutex<Vec<Event>>,
}

impl Talker<'_> {
    fn note(&self, event: Event) {
        self.trace.lock().unwrap().push(event);
    }
}

impl Program for Talker<'_> {
    fn run<M: Machine>(&self, machine: &M) -> Result<(), ProgramError> {
        let number = machine.number();
        let doorbell = machine.doorbell();
        let answer = |call: &Call<'_>| {
            self.note((number.0, doorbell.now().as_ns(), "request", call.data()));
            // Half of the replies need another reply.
            if call.data() % 2 == 0 {
                return call.data() + 1;
            }
            call.send_with_reply(call.sender(), ADD, call.data() + 1, SECOND)
                .unwrap_or(u32::MAX)
        };
        let mut mailbox = machine.mailbox()?;
        mailbox.set_vector(ADD, &answer, "add")?;
        mailbox.join()?;
        let now = || doorbell.now().as_ns();
        let mut fast_runs = 0;
        let mut fast = |_| {
            fast_runs += 1;
            self.note((number.0, now(), "fast", fast_runs));
        };
        let mut slow_runs = 0;
        let mut slow = |_| {
            slow_runs += 1;
            self.note((number.0, now(), "slow", slow_runs));
        };
        let bodies: [&mut (dyn FnMut(u64) + Send); 2] = [&mut fast, &mut slow];
        let mut rates = RATES.into_iter();
        let mut loops = bodies.map(|body| ServoLoop {
            rate: rates.next().unwrap(),
            overrun: Overrun::Skip,
            body,
        });
        let background = |loops: &dyn Loops<Instant = u64>| {
            let mut count = u32::from(number.0) * 1000;
            while !machine.is_stopping() {
                for to in (0..PROGRAMS).filter(|&to| to != number.0) {
                    count += 1;
                    let reply = mailbox.send_with_reply(Processor(to), ADD, count, SECOND);
                    match reply {
                        Ok(reply) => self.note((number.0, now(), "reply", reply)),
                        Err(_) => self.note((number.0, now(), "no reply", count)),
                    }
                }
                let next = machine.doorbell().now().after(Duration::from_millis(5));
                while machine.doorbell().now() < next {
                    mailbox.serve(Duration::from_millis(5)).unwrap();
                }
            }
            for id in 0..2 {
                let counts = loops.statistics(LoopId(id)).unwrap();
                self.note((number.0, now(), "skipped", counts.skipped as u32));
                self.note((number.0, now(), "late", counts.worst_lateness));
            }
        };
        machine.with_loops(&mut loops, Duration::ZERO, background)
    }
}

/// The trace of half a second.
fn trace() -> Vec<Event> {
    let trace = Mutex::new(Vec::new());
    let talker = Talker { trace: &trace };
    let mut system = VirtualSystem::new(4096).unwrap();
    for number in 0..PROGRAMS {
        system.spawn(Processor(number), &talker).unwrap();
    }
    // On 1 the slow loop is interrupted; on 2 the fast one takes longer than its period.
    system.set_work(Processor(1), 0, 500_000).unwrap();
    system.set_work(Processor(1), 1, 6_000_000).unwrap();
    system.set_work(Processor(2), 0, 3_000_000).unwrap();
    let ended_at = system.run_until(500_000_000).unwrap();
    assert!((500_000_000..520_000_000).contains(&ended_at), "{ended_at}");
    trace.into_inner().unwrap()
}

fn words(trace: &[Event], number: u8, what: &str) -> Vec<u32> {
    let of = trace
        .iter()
        .filter(|event| event.0 == number && event.2 == what);
    of.map(|event| event.3).collect()
}

#[test]
fn two_runs_are_the_same() {
    let first = trace();
    assert_eq!(first, trace());
    for number in 0..PROGRAMS {
        // Its processor may be too busy to serve, but nobody is left without a reply.
        assert!(words(&first, number, "no reply").len() <= 2, "{number}");
        assert!(words(&first, number, "reply").len() > 20, "{number}");
        assert!(words(&first, number, "request").len() > 20, "{number}");
    }
    assert_eq!(words(&first, 0, "skipped"), [0, 0]);
    assert_eq!(words(&first, 0, "late"), [0, 0]);
    assert_eq!(words(&first, 1, "skipped"), [0, 0]);
    assert_eq!(words(&first, 1, "late"), [0, 500_000]);
    // Every second release of 200 finds the loop in progress.
    let skipped = words(&first, 2, "skipped");
    assert!((99..=101).contains(&skipped[0]), "{skipped:?}");
    // At exactly their instants, in the order of time over all processors.
    let fast: Vec<_> = first.iter().filter(|event| event.2 == "fast").collect();
    assert!(fast.iter().filter(|event| event.0 == 1).count() >= 200);
    assert!(fast.is_sorted_by_key(|event| event.1));
    for event in fast.windows(4).flatten().filter(|event| event.0 < 2) {
        let offset = fast.iter().find(|first| first.0 == event.0).unwrap().1;
        assert_eq!((event.1 - offset) % 2_500_000, 0, "{event:?}");
    }
}

#[test]
fn failures_are_reported_with_their_processors() {
    let mut system = VirtualSystem::new(64).unwrap();
    system
        .host(Processor(3), |machine| {
            machine.work(5000);
            Err("no hand")
        })
        .unwrap();
    system
        .host(Processor(4), |machine| {
            machine.work(3000);
            // The other one fails meanwhile; this is told at once.
            let bell = machine.doorbell();
            bell.wait(bell.prepare(), Instant::from_ns(1_000_000_000), None);
            assert_eq!(machine.now(), 5000);
            assert!(!machine.is_stopping(), "stopped");
            Ok::<_, String>(())
        })
        .unwrap();
    let Err(SimError::Failed(failures)) = system.run() else {
        panic!("both fail");
    };
    let failure = |number, cause| SimFailure {
        number: Processor(number),
        at_ns: 5000,
        cause,
    };
    assert_eq!(
        failures,
        [
            failure(3, Cause::Error("no hand".into())),
            failure(4, Cause::Panic("stopped".into())),
        ]
    );
    assert_eq!(
        failures[0].to_string(),
        "processor 3 at 0.000005000 s: no hand"
    );
}

#[test]
fn programs_that_do_not_end_are_ended() {
    let mut system = VirtualSystem::new(64).unwrap();
    system
        .host(Processor(0), |machine| -> Result<(), String> {
            loop {
                // Looks at nothing but its clock.
                machine.doorbell().now();
                machine.work(1_000_000);
            }
        })
        .unwrap();
    assert_eq!(cause(system), Cause::NotStopping);
    let mut system = VirtualSystem::new(64).unwrap();
    system
        .host(Processor(1), |machine| {
            while !machine.is_stopping() {
                machine.doorbell().now();
            }
            let bell = machine.doorbell();
            bell.wait(bell.prepare(), Instant::FOREVER, None);
            Ok::<_, String>(())
        })
        .unwrap();
    assert_eq!(cause(system), Cause::WaitsForever);
}

/// Why the only program of a system failed.
fn cause(system: VirtualSystem<'_>) -> Cause {
    match system.run_until(1_000_000) {
        Err(SimError::Failed(mut failures)) if failures.len() == 1 => failures.remove(0).cause,
        other => panic!("one fails, not {other:?}"),
    }
}

#[test]
fn a_late_program_is_dead_before_and_after() {
    let mut system = VirtualSystem::new(64).unwrap();
    system.begin_at(Processor(1), 5000).unwrap();
    system
        .host(Processor(1), |machine| {
            assert_eq!(machine.now(), 5000);
            machine.work(2000);
            Ok::<_, String>(())
        })
        .unwrap();
    system
        .host(Processor(2), |machine| {
            let bell = machine.doorbell();
            for evidence in [Evidence::Dead, Evidence::Alive, Evidence::Dead] {
                assert_eq!(bell.evidence(Processor(1)), evidence, "{}", machine.now());
                assert_eq!(bell.evidence(Processor(2)), Evidence::Alive);
                machine.work(6000);
            }
            Ok::<_, String>(())
        })
        .unwrap();
    assert_eq!(system.run().unwrap(), 18_000);
}

#[test]
fn processors_share_a_bus() {
    let file = tempfile::tempfile().unwrap();
    file.set_len(64).unwrap();
    let bus = LinuxBus::map(&file, 0, 0, 64, MapAccess::ReadWrite).unwrap();
    let mut system = VirtualSystem::with_bus(64, bus).unwrap();
    for (number, before) in [(1, 0), (2, 1), (3, 2)] {
        system
            .host(Processor(number), move |machine| {
                machine.work(1000);
                assert_eq!(machine.bus().read32(60)?, before);
                machine.bus().write32(60, before + 1)
            })
            .unwrap();
    }
    assert_eq!(system.run().unwrap(), 1000);
}

#[test]
fn numbers_are_checked() {
    let mut system = VirtualSystem::new(64).unwrap();
    let idle = |_: &_| Ok::<_, String>(());
    system.host(Processor(15), idle).unwrap();
    let error = system.host(Processor(15), idle).unwrap_err();
    assert!(matches!(error, SimError::Taken { .. }), "{error}");
    let error = system.host(Processor(32), idle).unwrap_err();
    assert_eq!(
        error.to_string(),
        "processor 32 does not exist: a system has 32 processors, numbered from 0"
    );
    assert_eq!(system.run().unwrap(), 0);
}

#[test]
fn a_handler_that_polls_is_ended() {
    let mut system = VirtualSystem::new(64).unwrap();
    system
        .host(Processor(0), |machine| {
            let (timer, bell) = (machine.platform(), machine.doorbell());
            let handler = || while bell.now() < Instant::from_ns(2000) {};
            timer.connect(handler, || {
                let _ = timer.arm(1000);
                bell.wait(bell.prepare(), Instant::from_ns(5000), None);
            })
        })
        .unwrap();
    let Err(SimError::Failed(failures)) = system.run() else {
        panic!("it fails");
    };
    assert_eq!(
        (&failures[0].cause, failures[0].at_ns),
        (&Cause::Polls, 1000)
    );
}

#[test]
fn all_processors_reach_the_memory_that_belongs_to_none() {
    let mut system = VirtualSystem::new(4096).unwrap();
    system.share_memory(64).unwrap();
    for number in 0..3 {
        let number = Processor(number);
        system
            .host(number, move |machine| {
                let memory = machine.shared_memory().ok_or("none")?;
                let offset = 4 * u32::from(number.0);
                memory
                    .set_word(offset, 100 + offset)
                    .map_err(|it| it.to_string())?;
                machine.work(1_000);
                for offset in [0, 4, 8] {
                    assert_eq!(memory.word(offset), Ok(100 + offset));
                }
                assert!(memory.word(64).is_err());
                Ok::<_, String>(())
            })
            .unwrap();
    }
    system.run().unwrap();
    let mut system = VirtualSystem::new(4096).unwrap();
    let none = |machine: &condor_rt::sim::SimMachine<_>| {
        assert!(machine.shared_memory().is_none());
        Ok::<_, String>(())
    };
    system.host(Processor(0), none).unwrap();
    system.run().unwrap();
}
