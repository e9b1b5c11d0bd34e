//! The motion queue against a program that ends at any write, and clients that send again.

use std::collections::HashMap;

use condor_hand::queue::{
    Answer, Identity, LedgerError, MotionQueue, ROW_BYTES, Reason, RestoreError, Row, State,
};
use proptest::prelude::*;

type Queue = MotionQueue<u32, 3, 2, 6>;

/// A write failed, or the program ended before or after it.
#[derive(Debug)]
struct Ended;

/// The rows, and the writes that are left in this life.
struct Store {
    bytes: Vec<u8>,
    left: u32,
    /// Whether the last write is done when the program ends.
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

    fn write(&mut self, row: usize, bytes: &Row) -> Result<(), Ended> {
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
    Control(usize, bool),
    /// A client's request, counted from its last one: 0 sends that again.
    Offer(usize, u32, bool),
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
        1 => client.clone().prop_map(Step::Open),
        2 => (client.clone(), any::<bool>()).prop_map(|(client, other)| Step::Control(client, other)),
        6 => (client, 0..3_u32, prop::bool::weighted(0.8))
            .prop_map(|(client, more, is_good)| Step::Offer(client, more, is_good)),
        3 => Just(Step::Start),
        3 => any::<bool>().prop_map(Step::End),
        1 => Just(Step::Abort),
        1 => (0..6_u32, any::<bool>(), any::<bool>())
            .prop_map(|(after, is_done, ends)| Step::Fail { after, is_done, ends }),
    ];
    prop::collection::vec(step, 1..120)
}

/// A program that is begun again whenever it ends, and what it has told.
struct World {
    store: Store,
    queue: Queue,
    /// The session and the last number of each client.
    clients: [Option<Identity>; 3],
    opened: Vec<u32>,
    starts: HashMap<Identity, u32>,
    told: HashMap<Identity, (State, Reason)>,
    /// Whether the program ends at the next write that fails.
    ends: bool,
}

impl World {
    fn new() -> Self {
        let mut store = Store::new();
        let queue = Queue::restore(&[], |row, bytes| store.write(row, bytes)).unwrap();
        Self {
            store,
            queue,
            clients: [None; 3],
            opened: Vec::new(),
            starts: HashMap::new(),
            told: HashMap::new(),
            ends: true,
        }
    }

    fn restart(&mut self) {
        self.store.left = u32::MAX;
        let bytes = self.store.bytes.clone();
        let store = &mut self.store;
        self.queue = Queue::restore(&bytes, |row, bytes| store.write(row, bytes)).unwrap();
        assert_eq!(
            (
                self.queue.running(),
                self.queue.waiting(),
                self.queue.in_control()
            ),
            (None, 0, None)
        );
    }

    fn go(&mut self, step: Step) -> Result<(), Ended> {
        let store = &mut self.store;
        let write = |row: usize, bytes: &Row| store.write(row, bytes);
        match step {
            Step::Open(client) => {
                if let Some(session) = self.queue.open(write)? {
                    assert!(!self.opened.contains(&session), "session {session} again");
                    self.opened.push(session);
                    self.clients[client] = Some(Identity { session, number: 0 });
                }
            }
            Step::Control(client, from_other) => {
                if let Some(Identity { session, .. }) = self.clients[client] {
                    let has = self.queue.take_control(session, from_other);
                    assert_eq!(has, self.queue.in_control() == Some(session));
                }
            }
            Step::Offer(client, more, is_good) => {
                let Some(last) = &mut self.clients[client] else {
                    return Ok(());
                };
                last.number += more;
                let identity = *last;
                let before = self.queue.answer(identity);
                let made = is_good.then_some(identity.number).ok_or(Reason::Limits);
                let answer = self.queue.offer(identity, write, || made)?;
                match (before, answer) {
                    (Answer::New, Answer::Known(State::Accepted | State::Refused, _)) => {}
                    (before, answer) => assert_eq!(before, answer),
                }
            }
            Step::Start => {
                if let Some((identity, number)) = self.queue.start(write)? {
                    assert_eq!(identity.number, number);
                    let starts = self.starts.entry(identity).or_default();
                    *starts += 1;
                    assert_eq!(*starts, 1, "{identity} runs twice");
                    let told = self.told.get(&identity);
                    assert!(
                        told.is_none_or(|(state, _)| *state == State::Accepted),
                        "{identity} runs after {told:?}"
                    );
                }
            }
            Step::End(is_done) => {
                let (state, reason) = if is_done {
                    (State::Done, Reason::None)
                } else {
                    (State::Aborted, Reason::Failure)
                };
                self.queue.end(state, reason, write)?;
            }
            Step::Abort => self.queue.abort(Reason::Command, write)?,
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

    /// What all clients are told now agrees with what they were told before.
    fn ask(&mut self) {
        for identity in self.clients.iter().flatten() {
            for number in 1..=identity.number {
                let identity = Identity {
                    number,
                    ..*identity
                };
                let before = self.told.get(&identity).copied();
                match (before, self.queue.answer(identity)) {
                    (Some((state, reason)), Answer::Known(now, why)) if state.is_final() => {
                        assert_eq!((state, reason), (now, why), "{identity}");
                    }
                    (Some(_), Answer::New) => panic!("{identity} is new again"),
                    (_, Answer::Known(State::Started, _)) => {
                        assert_eq!(self.queue.running(), Some(identity));
                    }
                    _ => {}
                }
                if let Answer::Known(state, reason) = self.queue.answer(identity) {
                    let has_run = self.starts.contains_key(&identity);
                    match state {
                        State::Done | State::Started => assert!(has_run, "{identity}"),
                        State::Refused | State::Lost => assert!(!has_run, "{identity}"),
                        _ => {}
                    }
                    self.told.insert(identity, (state, reason));
                }
            }
        }
    }
}

proptest! {
    #[test]
    fn nothing_runs_twice_and_answers_stay(steps in steps()) {
        let mut world = World::new();
        for step in steps {
            if let Err(Ended) = world.go(step) {
                world.store.left = u32::MAX;
                if world.ends {
                    world.restart();
                }
            }
            world.ask();
        }
    }

    #[test]
    fn any_bytes_are_a_ledger_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = Queue::restore(&bytes, |_, _| Ok::<_, Ended>(()));
    }

    #[test]
    fn a_ledger_with_changed_bytes_restores(at in 0..9 * ROW_BYTES, to in any::<u8>()) {
        let mut world = World::new();
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
        let restored = Queue::restore(&world.store.bytes, |_, _| Ok::<_, Ended>(()));
        prop_assert!(restored.is_ok() || at < ROW_BYTES);
    }
}

#[test]
fn the_ledger_of_something_else_is_refused_with_what_was_found() {
    let write = |_: usize, _: &Row| Ok::<_, Ended>(());
    let other = Queue::restore(b"CNDM and thirty-two bytes or more", write);
    let Err(RestoreError::Ledger(LedgerError::Format { magic, .. })) = other else {
        panic!("{other:?}");
    };
    assert_eq!(magic, u32::from_le_bytes(*b"CNDM"));
    let mut store = Store::new();
    MotionQueue::<(), 1, 5, 7>::restore(&[], |row, bytes| store.write(row, bytes)).unwrap();
    let other = Queue::restore(&store.bytes, write);
    assert_eq!(
        other
            .err()
            .map(|error| match error {
                RestoreError::Ledger(error) => error.to_string(),
                error => panic!("{error:?}"),
            })
            .unwrap(),
        "a ledger of 5 sessions and 7 requests; this one has 2 and 6"
    );
}

#[test]
fn control_is_taken_from_another_only_if_that_is_asked_for() {
    let mut world = World::new();
    let mut open = || {
        let store = &mut world.store;
        let opened = world.queue.open(|row, bytes| store.write(row, bytes));
        opened.unwrap().unwrap()
    };
    let (first, second) = (open(), open());
    let queue = &mut world.queue;
    assert!(queue.take_control(first, false));
    assert!(!queue.take_control(second, false));
    assert!(!queue.take_control(99, true), "no such session");
    assert!(queue.take_control(second, true));
    queue.give_up_control(first);
    assert_eq!(queue.in_control(), Some(second));
    queue.give_up_control(second);
    assert_eq!(queue.in_control(), None);
    // The one in control does not end for a new one.
    assert!(queue.take_control(first, false));
    let store = &mut world.store;
    let third = queue.open(|row, bytes| store.write(row, bytes)).unwrap();
    assert!(third > Some(second));
    let gone = Identity {
        session: second,
        number: 1,
    };
    assert_eq!(queue.answer(gone), Answer::NoSession);
}
