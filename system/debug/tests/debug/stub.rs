//! Stub and tracer on a processor whose program counts.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use condor_debug::sim::{self, SimProcessor};
use condor_debug::{
    Breakpoint, DebugRequest, HoldReason, ProgramState, Tracer, TracerError, Trigger, TriggerAccess,
};
use condor_mbox::sim::SimWindow;
use proptest::prelude::*;

/// How long anything may take on a machine that has much else to do.
const DEADLINE: Duration = Duration::from_secs(60);

pub(crate) const ATTACHED: DebugRequest = DebugRequest {
    attached: true,
    hold_exceptions: false,
    hold_start: false,
};

/// Waits until something is so.
pub(crate) fn until(mut is_so: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_so() {
        assert!(begun.elapsed() < DEADLINE, "it does not come");
        std::thread::yield_now();
    }
}

/// A processor that runs on a thread.
pub(crate) struct Running {
    pub(crate) processor: Arc<SimProcessor>,
    thread: Option<JoinHandle<u64>>,
}

impl Running {
    pub(crate) fn new(program: &[u32]) -> Self {
        let processor = Arc::new(SimProcessor::new(program).unwrap());
        let runs = Arc::clone(&processor);
        let thread = std::thread::spawn(move || runs.run().unwrap());
        Self {
            processor,
            thread: Some(thread),
        }
    }

    pub(crate) fn tracer(&self) -> Tracer<SimWindow> {
        let rung = Arc::clone(&self.processor);
        Tracer::new(self.processor.area().clone(), move || rung.ring())
    }

    /// The words of the program's memory.
    pub(crate) fn words(&self) -> Vec<u32> {
        let memory = self.processor.memory();
        let bytes = condor_mbox::MemoryWindow::size(memory);
        let words = (0..bytes / 4).map(|place| memory.word(4 * place).unwrap());
        words.collect()
    }

    /// Ends the program, which must not be held, and returns its counter.
    pub(crate) fn end(self) -> u64 {
        self.processor.end();
        self.counted()
    }

    /// Waits until it has ended, and returns its counter.
    fn counted(mut self) -> u64 {
        self.thread.take().unwrap().join().unwrap()
    }
}

/// A program whose last but one word is stored.
pub(crate) const STORING: [u32; 5] = [sim::COUNT, sim::COUNT, sim::STORE, 0, sim::JUMP];
pub(crate) const STORED: u64 = 3;

pub(crate) const fn at(address: u64) -> Breakpoint {
    Breakpoint::Instruction(address)
}

/// A trigger of the store.
fn written() -> Breakpoint {
    Breakpoint::Trigger(Trigger {
        address: 4 * STORED,
        access: TriggerAccess::Write,
        bytes: 4,
    })
}

/// The words of [`STORING`] without what it stores.
fn program(running: &Running) -> Vec<u32> {
    let mut words = running.words();
    words[STORED as usize] = 0;
    words
}

const PROGRAM: [u32; 4] = [sim::COUNT, sim::COUNT, sim::COUNT, sim::JUMP];

#[test]
fn a_stopped_program_stays_as_it_was_and_goes_on() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    assert_eq!(tracer.stop(), Ok(HoldReason::Stopped));
    let counted = tracer.register(sim::COUNTER).unwrap();
    assert_eq!(tracer.stop(), Ok(HoldReason::Stopped), "it stands already");
    assert_eq!(tracer.register(sim::COUNTER), Ok(counted));
    tracer.set_register(sim::COUNTER, 1 << 40).unwrap();
    tracer.plant(&[], true).unwrap();
    assert_eq!(tracer.state(), Ok(ProgramState::Runs));
    assert!(running.end() >= 1 << 40);
}

#[test]
fn a_breakpoint_stops_where_it_is_and_leaves_no_trace() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    tracer.set_mode(ATTACHED).unwrap();
    // Into a running program.
    tracer.plant(&[at(4)], false).unwrap();
    until(|| tracer.state() == Ok(ProgramState::Held(HoldReason::Breakpoint)));
    assert_eq!(tracer.register(sim::PC), Ok(4));
    assert_eq!(tracer.planted().unwrap()[0].original, sim::COUNT);
    let counted = tracer.register(sim::COUNTER).unwrap();
    // One instruction further: a step.
    tracer.plant(&[at(8)], true).unwrap();
    until(|| tracer.holds() == Ok(2) && tracer.state() != Ok(ProgramState::Runs));
    assert_eq!(tracer.register(sim::COUNTER), Ok(counted + 1));
    tracer.release().unwrap();
    assert_eq!(running.words(), PROGRAM);
    assert_eq!(tracer.mode(), Ok(DebugRequest::default()));
    running.end();
}

#[test]
fn an_exception_waits_for_a_debugger_only_if_one_wants_it() {
    let fault = 77;
    let running = Running::new(&[sim::COUNT, fault]);
    assert_eq!(running.counted(), 1, "it is fatal");

    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    let mode = DebugRequest {
        hold_exceptions: true,
        ..DebugRequest::default()
    };
    tracer.set_mode(mode).unwrap();
    running.processor.memory().set_word(8, fault).unwrap();
    until(|| tracer.state() == Ok(ProgramState::Held(HoldReason::Exception)));
    // Nobody is attached; somebody comes, repairs it, and goes.
    running.processor.memory().set_word(8, sim::COUNT).unwrap();
    tracer.release().unwrap();
    assert_eq!(tracer.mode(), Ok(mode));
    running.end();
}

#[test]
fn the_programs_own_breakpoint_is_passed_once() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    tracer.set_mode(ATTACHED).unwrap();
    let memory = running.processor.memory();
    memory.set_word(4, sim::BREAKPOINT).unwrap();
    until(|| tracer.state() == Ok(ProgramState::Held(HoldReason::Breakpoint)));
    let holds = tracer.holds().unwrap();
    tracer.plant(&[], true).unwrap();
    // It comes again with the next turn, two counts later.
    until(|| tracer.holds() == Ok(holds + 1) && tracer.state() != Ok(ProgramState::Runs));
    memory.set_word(4, sim::COUNT).unwrap();
    tracer.release().unwrap();
    running.end();
}

#[test]
fn what_cannot_be_planted_is_refused_by_address_and_nothing_resumes() {
    let running = Running::new(&PROGRAM);
    let tracer = running.tracer();
    tracer.stop().unwrap();
    let address = 0x1000;
    let refused = Err(TracerError::Refused { address });
    assert_eq!(tracer.plant(&[at(0), at(address)], true), refused);
    assert_eq!(tracer.state(), Ok(ProgramState::Held(HoldReason::Stopped)));
    assert_eq!(tracer.planted().unwrap().len(), 1);
    tracer.release().unwrap();
    assert_eq!(running.words(), PROGRAM);
    running.end();
}

#[test]
fn a_trigger_stops_before_the_store_until_it_is_removed() {
    let running = Running::new(&STORING);
    let tracer = running.tracer();
    tracer.set_mode(ATTACHED).unwrap();
    tracer.plant(&[written()], false).unwrap();
    until(|| tracer.state() == Ok(ProgramState::Held(HoldReason::Trigger)));
    assert_eq!(tracer.register(sim::PC), Ok(8));
    let counted = tracer.register(sim::COUNTER).unwrap() as u32;
    let stored = running.words()[STORED as usize];
    assert_eq!(stored.wrapping_add(2), counted, "not yet");
    // The processor has no room for another, and none for instructions.
    for access in [TriggerAccess::Write, TriggerAccess::Execute] {
        let trigger = Trigger {
            address: 0,
            access,
            bytes: 4,
        };
        let wanted = [written(), Breakpoint::Trigger(trigger)];
        let refused = Err(TracerError::Refused { address: 0 });
        assert_eq!(tracer.plant(&wanted, true), refused);
    }
    // One step further, without the trigger.
    tracer.plant(&[at(16)], true).unwrap();
    until(|| tracer.state() == Ok(ProgramState::Held(HoldReason::Breakpoint)));
    assert_eq!(running.words()[STORED as usize], counted);
    tracer.release().unwrap();
    assert_eq!(program(&running), STORING);
    running.end();
}

#[test]
fn a_processor_that_is_off_gives_no_answer() {
    let processor = SimProcessor::new(&PROGRAM).unwrap();
    let tracer = Tracer::new(processor.area().clone(), || {});
    assert_eq!(tracer.stop(), Err(TracerError::NoAnswer));
}

#[derive(Clone, Debug)]
enum Act {
    Stop,
    Plant(Vec<Breakpoint>, bool),
    /// The debugger is killed, and another one comes.
    Die,
    Release,
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        Just(Act::Stop),
        (prop::collection::vec(0..=STORED, 0..4), any::<bool>()).prop_map(|(places, resumes)| {
            let breakpoint = |place| {
                if place == STORED {
                    written()
                } else {
                    at(4 * place)
                }
            };
            Act::Plant(places.into_iter().map(breakpoint).collect(), resumes)
        }),
        Just(Act::Die),
        Just(Act::Release),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever debuggers do and where they die, a release leaves a program that runs as it was.
    #[test]
    fn a_release_leaves_nothing(acts in prop::collection::vec(act(), 0..20)) {
        let running = Running::new(&STORING);
        let mut tracer = running.tracer();
        tracer.set_mode(ATTACHED).unwrap();
        for act in acts {
            match act {
                Act::Stop => { tracer.stop().unwrap(); }
                Act::Plant(places, resumes) => {
                    tracer.set_mode(ATTACHED).unwrap();
                    tracer.plant(&places, resumes).unwrap();
                    let planted: Vec<_> =
                        tracer.planted().unwrap().iter().map(|it| it.breakpoint).collect();
                    prop_assert!(planted.iter().all(|it| places.contains(it)));
                    prop_assert!(places.iter().all(|it| planted.contains(it)));
                }
                Act::Die => tracer = running.tracer(),
                Act::Release => {
                    tracer.release().unwrap();
                    prop_assert_eq!(program(&running), STORING.to_vec());
                }
            }
        }
        until(|| tracer.try_release().unwrap());
        prop_assert_eq!(program(&running), STORING.to_vec());
        prop_assert_eq!(tracer.state(), Ok(ProgramState::Runs));
        running.end();
    }
}
