//! The motion queue against a program that ends at any write, and clients that send again.

use std::collections::HashMap;

use condor_hand::ImageError;
use condor_robot::queue::{
    InControl, LedgerRow, MotionQueue, OWN, QueueAnswer, ROW_BYTES, RefusalReason, RequestIdentity,
    RequestState, RestoreError, SessionOwner,
};
use proptest::prelude::*;

/// The smallest queue: 2 sessions and 4 outcomes.
type Queue = MotionQueue<u32, 1>;

/// A write failed, or the program ended before or after it.
#[derive(Debug)]
struct Ended;

/// The rows, and the writes that are left in this incarnation.
struct Store {
    bytes: Vec<u8>,
    left: u32,
    /// True if the last write is done when the program ends.
    last_is_done: bool,
}

impl Store {
    fn new() -> Self {
        Self {
            bytes: Vec::new(),
            left: u32::MAX,
            last_is_done: false,
        }
    }

    fn write(&mut self, row: usize, bytes: &LedgerRow) -> Result<(), Ended> {
        if self.left > 0 || self.last_is_done {
            let at = row * ROW_BYTES;
            if self.bytes.len() < at + ROW_BYTES {
                self.bytes.resize(at + ROW_BYTES, 0);
            }
            self.bytes[at..at + ROW_BYTES].copy_from_slice(bytes);
        }
        let Some(left) = self.left.checked_sub(1) else {
            self.last_is_done = false;
            return Err(Ended);
        };
        self.left = left;
        Ok(())
    }
}

#[derive(Clone, Copy, Debug)]
enum Step {
    Open(usize),
    /// The program of a client ends: its session is closed.
    Leave(usize),
    Control(usize, bool),
    /// A client's request, counted from its last one: 0 sends that again.
    Offer(usize, u32, bool),
    /// The same for a request that the client withdraws.
    Withdraw(usize, u32),
    Start,
    End(bool),
    Abort,
    /// After so many more writes one fails, done or not; then the program ends, or goes on.
    Fail {
        after: u32,
        is_done: bool,
        ends: bool,
    },
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let client = 0..3_usize;
    let step = prop_oneof![
        2 => client.clone().prop_map(Step::Open),
        1 => client.clone().prop_map(Step::Leave),
        2 => (client.clone(), any::<bool>()).prop_map(|(client, other)| Step::Control(client, other)),
        6 => (client.clone(), 0..3_u32, prop::bool::weighted(0.8))
            .prop_map(|(client, more, is_good)| Step::Offer(client, more, is_good)),
        1 => (client, 0..3_u32).prop_map(|(client, more)| Step::Withdraw(client, more)),
        3 => Just(Step::Start),
        3 => any::<bool>().prop_map(Step::End),
        1 => Just(Step::Abort),
        1 => (0..6_u32, any::<bool>(), any::<bool>())
            .prop_map(|(after, is_done, ends)| Step::Fail { after, is_done, ends }),
    ];
    prop::collection::vec(step, 1..120)
}

/// A program that is begun again whenever it ends, and what it has told.
struct World<const N: usize = 1> {
    store: Store,
    queue: MotionQueue<u32, N>,
    /// The session and the last number of each client.
    clients: [Option<RequestIdentity>; 3],
    opened: Vec<u32>,
    starts: HashMap<RequestIdentity, u32>,
    told: HashMap<RequestIdentity, (RequestState, RefusalReason)>,
    /// Requests that were told that they never run.
    never: Vec<RequestIdentity>,
    /// True if the program ends at the next write that fails.
    ends: bool,
}

impl<const N: usize> World<N> {
    fn new() -> Self {
        let mut store = Store::new();
        let queue = MotionQueue::restore(&[], 1, |row, bytes| store.write(row, bytes)).unwrap();
        Self {
            store,
            queue,
            clients: [None; 3],
            opened: Vec::new(),
            starts: HashMap::new(),
            told: HashMap::new(),
            never: Vec::new(),
            ends: true,
        }
    }

    fn restart(&mut self) {
        self.store.left = u32::MAX;
        let bytes = self.store.bytes.clone();
        let store = &mut self.store;
        self.queue = MotionQueue::restore(&bytes, 1, |row, bytes| store.write(row, bytes)).unwrap();
        assert_eq!(
            (
                self.queue.running(),
                self.queue.waiting(),
                self.queue.in_control()
            ),
            (None, 0, InControl::Nobody)
        );
    }

    fn go(&mut self, step: Step) -> Result<(), Ended> {
        let store = &mut self.store;
        let write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
        match step {
            Step::Open(client) => {
                let owner = SessionOwner {
                    processor: client as u32,
                    incarnation: self.opened.len() as u32,
                };
                if let Some(session) = self.queue.open(owner, write)? {
                    assert_eq!(self.queue.ledger().owner(session), Some(owner));
                    assert!(!self.opened.contains(&session), "session {session} again");
                    self.opened.push(session);
                    self.clients[client] = Some(RequestIdentity { session, number: 0 });
                }
            }
            Step::Leave(client) => {
                if let Some(RequestIdentity { session, .. }) = self.clients[client] {
                    self.queue.close(session, write)?;
                    assert_ne!(self.queue.in_control(), InControl::Session(session));
                }
            }
            Step::Control(client, from_other) => {
                if let Some(RequestIdentity { session, .. }) = self.clients[client] {
                    let has = self.queue.take_control(session, from_other);
                    assert_eq!(has, self.queue.in_control() == InControl::Session(session));
                }
            }
            Step::Offer(client, more, is_good) => {
                let Some(last) = &mut self.clients[client] else {
                    return Ok(());
                };
                last.number += more;
                let identity = *last;
                let before = self.queue.answer(identity);
                let made = is_good
                    .then_some(identity.number)
                    .ok_or(RefusalReason::Limits);
                let answer = self.queue.offer(identity, write, || made)?;
                match (before, answer) {
                    (
                        QueueAnswer::New,
                        QueueAnswer::Known(RequestState::Accepted | RequestState::Refused, _),
                    ) => {}
                    (before, answer) => assert_eq!(before, answer),
                }
            }
            Step::Withdraw(client, more) => {
                let Some(last) = &mut self.clients[client] else {
                    return Ok(());
                };
                last.number += more;
                let identity = *last;
                let before = self.queue.answer(identity);
                let answer = self.queue.withdraw(identity, write)?;
                let withdrawn = QueueAnswer::Known(RequestState::Refused, RefusalReason::Withdrawn);
                let expected = match before {
                    QueueAnswer::New => withdrawn,
                    before => before,
                };
                assert_eq!(answer, expected);
            }
            Step::Start => {
                if let Some((identity, number)) = self.queue.start(write)? {
                    assert_eq!(identity.number, number);
                    let starts = self.starts.entry(identity).or_default();
                    *starts += 1;
                    assert_eq!(*starts, 1, "{identity} runs twice");
                    assert!(!self.never.contains(&identity), "{identity} runs");
                    let told = self.told.get(&identity);
                    assert!(
                        told.is_none_or(|(state, _)| *state == RequestState::Accepted),
                        "{identity} runs after {told:?}"
                    );
                }
            }
            Step::End(is_done) => {
                let (state, reason) = if is_done {
                    (RequestState::Done, RefusalReason::None)
                } else {
                    (RequestState::Aborted, RefusalReason::Failure)
                };
                self.queue.end(state, reason, write)?;
            }
            Step::Abort => self.queue.abort(RefusalReason::Command, write)?,
            Step::Fail {
                after,
                is_done,
                ends,
            } => {
                (store.left, store.last_is_done) = (after, is_done);
                self.ends = ends;
            }
        }
        Ok(())
    }

    /// Checks that all clients get the same answers as before, or later states of their requests.
    fn ask(&mut self) {
        for identity in self.clients.iter().flatten() {
            for number in 1..=identity.number {
                let identity = RequestIdentity {
                    number,
                    ..*identity
                };
                let before = self.told.get(&identity).copied();
                match (before, self.queue.answer(identity)) {
                    (Some((state, reason)), QueueAnswer::Known(now, why)) if state.is_final() => {
                        assert_eq!((state, reason), (now, why), "{identity}");
                    }
                    (Some(_), QueueAnswer::New | QueueAnswer::Never) => {
                        panic!("{identity} is new again")
                    }
                    (None, QueueAnswer::Never) => {
                        assert!(!self.starts.contains_key(&identity), "{identity}");
                        self.never.push(identity);
                    }
                    (_, QueueAnswer::Known(RequestState::Started, _)) => {
                        assert_eq!(self.queue.running(), Some(identity));
                    }
                    _ => {}
                }
                if let QueueAnswer::Known(state, reason) = self.queue.answer(identity) {
                    let has_run = self.starts.contains_key(&identity);
                    match state {
                        RequestState::Done | RequestState::Started => {
                            assert!(has_run, "{identity}");
                        }
                        RequestState::Refused | RequestState::Lost => {
                            assert!(!has_run, "{identity}");
                        }
                        _ => {}
                    }
                    self.told.insert(identity, (state, reason));
                }
            }
        }
    }
}

/// Takes the steps, and asks after each one.
fn run<const N: usize>(steps: &[Step]) {
    let mut world = World::<N>::new();
    for &step in steps {
        if let Err(Ended) = world.go(step) {
            world.store.left = u32::MAX;
            if world.ends {
                world.restart();
            } else {
                // As a program must that goes on.
                world.store.bytes = world.queue.ledger().rows().collect::<Vec<_>>().concat();
            }
        }
        world.ask();
    }
}

/// Found by the test below: the next incarnation of the program must know which sessions were closed.
#[test]
fn a_session_that_was_closed_stays_so() {
    let fail = |after, ends| Step::Fail {
        after,
        is_done: false,
        ends,
    };
    run::<1>(&[
        Step::Open(1),
        Step::Leave(1),
        Step::Offer(1, 1, true),
        fail(0, true),
        Step::Open(0),
        Step::Control(1, false),
        Step::Offer(1, 0, true),
        Step::Start,
    ]);
}

proptest! {
    #[test]
    fn nothing_runs_twice_and_answers_stay(steps in steps()) {
        run::<1>(&steps);
        run::<2>(&steps);
    }

    #[test]
    fn any_bytes_are_a_ledger_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = Queue::restore(&bytes, 1, |_, _| Ok::<_, Ended>(()));
    }

    #[test]
    fn a_ledger_with_changed_bytes_restores(at in 0..Queue::ROWS * ROW_BYTES, to in any::<u8>()) {
        let mut world = World::<1>::new();
        for step in [
            Step::Open(0),
            Step::Control(0, false),
            Step::Offer(0, 1, true),
            Step::Start,
            Step::Offer(0, 1, true),
        ] {
            world.go(step).unwrap();
        }
        world.store.bytes[at] = to;
        let restored = Queue::restore(&world.store.bytes, 1, |_, _| Ok::<_, Ended>(()));
        prop_assert!(restored.is_ok() || at < ROW_BYTES);
    }
}

#[test]
fn the_ledger_of_something_else_is_refused_with_what_was_found() {
    let write = |_: usize, _: &LedgerRow| Ok::<_, Ended>(());
    let other = Queue::restore(b"CNDM and thirty-two bytes or more", 1, write);
    let Err(RestoreError::Ledger(ImageError::Magic { found, .. })) = other else {
        panic!("{other:?}");
    };
    assert_eq!(found, *b"CNDM");
    let mut store = Store::new();
    MotionQueue::<(), 2>::restore(&[], 1, |row, bytes| store.write(row, bytes)).unwrap();
    let other = Queue::restore(&store.bytes, 1, write);
    assert_eq!(
        other
            .err()
            .map(|error| match error {
                RestoreError::Ledger(error) => error.to_string(),
                error @ RestoreError::Write(_) => panic!("{error:?}"),
            })
            .unwrap(),
        "the image (the binary file) is for 4 sessions, but this program for 2; build both for the same number"
    );
}

#[test]
fn control_is_taken_from_another_only_if_that_is_asked_for() {
    let mut world = World::<1>::new();
    let mut open = || {
        let store = &mut world.store;
        let opened = world.queue.open(SessionOwner::default(), |row, bytes| {
            store.write(row, bytes)
        });
        opened.unwrap().unwrap()
    };
    let (first, second) = (open(), open());
    let queue = &mut world.queue;
    assert!(queue.take_control(first, false));
    assert!(!queue.take_control(second, false));
    assert!(!queue.take_control(99, true), "no such session");
    assert!(queue.take_control(second, true));
    queue.give_up_control(first);
    assert_eq!(queue.in_control(), InControl::Session(second));
    queue.give_up_control(second);
    assert_eq!(queue.in_control(), InControl::Nobody);
    // The one in control does not end for a new one.
    assert!(queue.take_control(first, false));
    let store = &mut world.store;
    let third = queue.open(SessionOwner::default(), |row, bytes| {
        store.write(row, bytes)
    });
    let third = third.unwrap();
    assert!(third > Some(second));
    let gone = RequestIdentity {
        session: second,
        number: 1,
    };
    assert_eq!(queue.answer(gone), QueueAnswer::NoSession);
}

/// Opens a session of a processor.
fn open(world: &mut World, processor: u32) -> u32 {
    let store = &mut world.store;
    let owner = SessionOwner {
        processor,
        incarnation: 1,
    };
    let write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
    world.queue.open(owner, write).unwrap().unwrap()
}

/// The numbers of all sessions.
fn sessions(world: &World) -> Vec<u32> {
    world
        .queue
        .ledger()
        .sessions()
        .map(|(number, _)| number)
        .collect()
}

#[test]
fn a_client_that_opens_many_sessions_takes_none_of_another() {
    let mut world = World::<1>::new();
    let other = open(&mut world, 1);
    let mut last = 0;
    for _ in 0..5 {
        last = open(&mut world, 2);
    }
    assert_eq!(sessions(&world), [other, last]);
}

#[test]
fn a_closed_session_ends_before_one_that_is_used() {
    let mut world = World::<1>::new();
    let (used, gone) = (open(&mut world, 1), open(&mut world, 2));
    let store = &mut world.store;
    let write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
    world.queue.close(gone, write).unwrap();
    let next = open(&mut world, 1);
    assert_eq!(sessions(&world), [used, next]);
}

#[test]
fn refused_requests_of_others_leave_what_was_done_in_its_row() {
    let mut world = World::<1>::new();
    let (mine, other) = (open(&mut world, 1), open(&mut world, 2));
    let store = &mut world.store;
    let mut write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
    let queue = &mut world.queue;
    queue.take_control(mine, false);
    let of = |session, number| RequestIdentity { session, number };
    queue.offer(of(mine, 1), &mut write, || Ok(1)).unwrap();
    queue.start(&mut write).unwrap();
    let mut refuse = |queue: &mut Queue, numbers: core::ops::Range<u32>| {
        for number in numbers {
            let answer = queue.offer(of(other, number), &mut write, || Ok(number));
            let refused = QueueAnswer::Known(RequestState::Refused, RefusalReason::NotInControl);
            assert_eq!(answer.unwrap(), refused);
        }
    };
    refuse(queue, 1..9);
    let store = &mut world.store;
    let write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
    queue
        .end(RequestState::Done, RefusalReason::None, write)
        .unwrap();
    for number in 9..20 {
        let store = &mut world.store;
        let write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
        queue
            .offer(of(other, number), write, || Ok(number))
            .unwrap();
        let done = QueueAnswer::Known(RequestState::Done, RefusalReason::None);
        assert_eq!(queue.answer(of(mine, 1)), done, "{number}");
    }
}

#[test]
fn the_number_of_a_session_whose_row_is_damaged_is_not_given_again() {
    let mut world = World::<1>::new();
    for step in [
        Step::Open(0),
        Step::Control(0, false),
        Step::Offer(0, 1, true),
    ] {
        world.go(step).unwrap();
    }
    let session = world.clients[0].unwrap().session;
    world.store.bytes[ROW_BYTES..][..ROW_BYTES].fill(0);
    world.restart();
    assert!(open(&mut world, 1) > session);
}

#[test]
fn sessions_have_new_numbers_after_the_ledger_was_deleted() {
    let mut world = World::<1>::new();
    let before = open(&mut world, 1);
    let store = &mut world.store;
    // The time in seconds is later.
    world.queue = Queue::restore(&[], before + 7, |row, bytes| store.write(row, bytes)).unwrap();
    assert_eq!(open(&mut world, 1), before + 7);
    assert_eq!(open(&mut world, 1), before + 8);
}

#[test]
fn a_ledger_that_is_cut_is_refused() {
    let mut world = World::<1>::new();
    open(&mut world, 1);
    for len in [1, ROW_BYTES, 3 * ROW_BYTES + 5, Queue::ROWS * ROW_BYTES - 1] {
        let bytes = &world.store.bytes[..len];
        let restored = Queue::restore(bytes, 1, |_, _| Ok::<_, Ended>(()));
        let Err(RestoreError::Ledger(ImageError::Length { needed, len: found })) = restored else {
            panic!("{len} bytes: {restored:?}");
        };
        assert_eq!((found, needed), (len, Queue::ROWS * ROW_BYTES));
    }
}

#[test]
fn what_may_have_been_in_a_damaged_row_does_not_run() {
    for row in 1..Queue::ROWS {
        let mut world = World::<1>::new();
        for step in [
            Step::Open(0),
            Step::Control(0, false),
            Step::Offer(0, 1, true),
        ] {
            world.go(step).unwrap();
        }
        let identity = world.clients[0].unwrap();
        world.store.bytes[row * ROW_BYTES..][..ROW_BYTES].fill(0);
        world.restart();
        let answer = world.queue.answer(identity);
        assert_ne!(answer, QueueAnswer::New, "with row {row} gone");
        let next = RequestIdentity {
            number: identity.number + 1,
            ..identity
        };
        assert_ne!(
            world.queue.answer(next),
            QueueAnswer::New,
            "with row {row} gone"
        );
    }
}

#[test]
fn changes_are_counted_beyond_32_bits() {
    let mut store = Store::new();
    let mut write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
    let mut queue = Queue::restore(&[], 1, &mut write).unwrap();
    let session = queue
        .open(SessionOwner::default(), &mut write)
        .unwrap()
        .unwrap();
    queue.take_control(session, false);
    queue
        .offer(RequestIdentity { session, number: 1 }, &mut write, || Ok(1))
        .unwrap();
    // When the session was last used: the greatest number of 32 bits.
    let row = &mut store.bytes[ROW_BYTES..][..ROW_BYTES];
    row[12..16].fill(0xff);
    let sum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&row[..28]);
    row[28..].copy_from_slice(&sum.to_le_bytes());
    let bytes = store.bytes.clone();
    let mut write = |row: usize, bytes: &LedgerRow| store.write(row, bytes);
    let mut queue = Queue::restore(&bytes, 1, &mut write).unwrap();
    queue.take_control(session, false);
    for number in 2..6 {
        let identity = RequestIdentity { session, number };
        queue.offer(identity, &mut write, || Ok(number)).unwrap();
        queue.start(&mut write).unwrap();
        queue
            .end(RequestState::Done, RefusalReason::None, &mut write)
            .unwrap();
        let done = QueueAnswer::Known(RequestState::Done, RefusalReason::None);
        assert_eq!(queue.answer(identity), done);
    }
    let restored = Queue::restore(&store.bytes, 1, |_, _| Ok::<_, Ended>(())).unwrap();
    let answer = |number| restored.answer(RequestIdentity { session, number });
    assert_eq!(answer(1), QueueAnswer::Forgotten);
    for number in 3..6 {
        assert_eq!(
            answer(number),
            QueueAnswer::Known(RequestState::Done, RefusalReason::None),
            "{number}"
        );
    }
}

#[test]
fn requests_of_the_program_itself_run_and_leave_no_row() {
    let none = |_: usize, _: &LedgerRow| -> Result<(), Ended> { panic!("a row is written") };
    let mut queue = MotionQueue::<u32, 1>::restore(&[], 1000, |_, _| Ok::<_, Ended>(())).unwrap();
    let before: Vec<_> = queue.ledger().rows().collect();
    assert_eq!(queue.enqueue(1), Err(RefusalReason::NotInControl));
    assert!(queue.take_control(OWN, false));
    assert_eq!(queue.in_control(), InControl::Program);
    queue.enqueue(1).unwrap();
    assert_eq!(queue.enqueue(2), Err(RefusalReason::Full));
    let (identity, work) = queue.start(none).unwrap().unwrap();
    assert_eq!((identity.session, work), (OWN, 1));
    // The numbers of another incarnation, a second later, are others.
    assert!(identity.number > 1000);
    queue.enqueue(2).unwrap();
    queue.abort(RefusalReason::Command, none).unwrap();
    queue
        .end(RequestState::Done, RefusalReason::None, none)
        .unwrap();
    assert_eq!((queue.running(), queue.waiting()), (None, 0));
    assert_eq!(queue.answer(identity), QueueAnswer::NoSession);
    assert_eq!(queue.ledger().rows().collect::<Vec<_>>(), before);
}
