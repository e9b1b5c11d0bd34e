//! [`System`]: processors with programs, and a host that requests turns.

use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;

/// Few instants and few processors, so that much happens at the same time.
const INSTANTS: u64 = 12;
const PROCESSORS: u8 = 8;

#[derive(Clone, Debug)]
pub(crate) struct System {
    pub(crate) processors: Vec<Program>,
    pub(crate) requests: Vec<Request>,
}

/// What a processor does. Numbers of processors that there are not are rung for nothing.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub(crate) begins_at: u64,
    /// The more urgent one first.
    pub(crate) loops: Vec<Loop>,
    pub(crate) steps: Vec<Step>,
}

/// It is released as soon as the program begins, and then every `period`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Loop {
    pub(crate) period: u64,
    pub(crate) work: u64,
    pub(crate) rings: Option<u8>,
}

/// What a background does.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Step {
    Pass(u64),
    /// It waits so long, if it has not been rung since it waited last.
    Wait(u64),
    Ring(u8),
    /// Has the service ring a processor.
    Tell(u8),
    /// Asks the service and waits for the answer.
    Ask,
}

/// What a part of the host does with a turn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Request {
    pub(crate) at: u64,
    /// Rings this one, or tells all to stop.
    pub(crate) rings: Option<u8>,
}

/// When, who and what.
pub(crate) type Event = (u64, u8, What);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum What {
    Began,
    Passed,
    /// A wait has ended, after so many rings in all.
    Waited(u32),
    /// The loop of this rank.
    Ran(usize),
    /// A part of the host had its turn.
    Came,
    Ended,
}

/// The number of the part of the host that makes the first request; the others follow.
pub(crate) const HOST: u8 = 0;
/// The number of the service.
pub(crate) const SERVICE: u8 = 2;
/// The number of the first processor; the others follow.
pub(crate) const FIRST: u8 = 3;

pub(crate) fn systems() -> impl Strategy<Value = System> {
    let any_two_or_more = vec(programs(), 2..=usize::from(PROCESSORS));
    (any_two_or_more, vec(requests(), 0..=2)).prop_map(|(processors, requests)| System {
        processors,
        requests,
    })
}

fn programs() -> impl Strategy<Value = Program> {
    let loops = prop_oneof![
        2 => Just(Vec::new()),
        1 => loops(6, 2).prop_map(|one| vec![one]),
        // Both together leave time for the background.
        1 => (loops(6, 2), loops(10, 4)).prop_map(|(fast, slow)| vec![fast, slow]),
    ];
    (prop_oneof![Just(0), 0..INSTANTS], loops, vec(steps(), 1..6)).prop_map(
        |(begins_at, loops, steps)| Program {
            begins_at,
            loops,
            steps,
        },
    )
}

fn loops(least_period: u64, most_work: u64) -> impl Strategy<Value = Loop> {
    let periods = least_period..2 * least_period;
    (periods, 0..=most_work, option::of(numbers())).prop_map(|(period, work, rings)| Loop {
        period,
        work,
        rings,
    })
}

fn numbers() -> impl Strategy<Value = u8> {
    FIRST..FIRST + PROCESSORS
}

fn steps() -> impl Strategy<Value = Step> {
    prop_oneof![
        (0..INSTANTS).prop_map(Step::Pass),
        (0..INSTANTS).prop_map(Step::Wait),
        (0..INSTANTS).prop_map(Step::Wait),
        numbers().prop_map(Step::Ring),
        numbers().prop_map(Step::Tell),
        Just(Step::Ask),
    ]
}

fn requests() -> impl Strategy<Value = Request> {
    let rings = prop_oneof![3 => numbers().prop_map(Some), 1 => Just(None)];
    (0..3 * INSTANTS, rings).prop_map(|(at, rings)| Request { at, rings })
}
