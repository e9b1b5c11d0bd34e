//! A program that stops for good after any of its stores leaves nothing behind that has to be
//! cleaned up, nor anything that is believed later.
//!
//! The windows of one mailbox refuse everything from the k-th store on, for every k that the
//! operation reaches; its peer survives, and a new program takes over its number. (For a
//! publisher see `published.rs`.)
//!
//! It fails if the epoch of a request or of a reply is not compared, if a new program lives the
//! same incarnation as the former, if a ticket does not compare the incarnation of its peer, and if an entry
//! carries its sequence before its words.

use std::cell::RefCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::layout::{self, SLOTS};
use condor_mbox::sim::{SimDoorbell, SimMailbox, SimSystem, SimWindow};
use condor_mbox::window::{WindowError, WindowErrorKind};
use condor_mbox::{
    Call, CriticalSection, LoadOrder, Mailbox, MailboxError, MemoryWindow, MessageTicket,
    Messenger, PeerState, Processor, StoreOrder, Vector, Waiting, Windows,
};

/// The processor that stops.
const A: Processor = Processor(0);
/// The one that survives.
const B: Processor = Processor(1);
const VECTORS: u32 = 3;
/// In virtual time; a waiter asks several times meanwhile whether its peer lives.
const PATIENCE: Duration = Duration::from_millis(2);

type Mortal = Mailbox<'static, (MortalWindow, SimDoorbell, CriticalSection), 2>;
type Survivor = &'static SimMailbox<'static, 2>;

/// How many stores a program still lives for.
struct Stores {
    left: AtomicU32,
    stopped: AtomicBool,
}

impl Stores {
    fn unlimited() -> Arc<Self> {
        Arc::new(Self {
            left: AtomicU32::new(u32::MAX),
            stopped: AtomicBool::new(false),
        })
    }

    fn stop_after(&self, stores: u32) {
        self.left.store(stores, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    fn live(&self, stores: u32) -> Result<(), Stopped> {
        let left = self.left.load(Ordering::Relaxed).checked_sub(stores);
        match left {
            Some(left) if !self.stopped() => {
                self.left.store(left, Ordering::Relaxed);
                Ok(())
            }
            _ => {
                self.stopped.store(true, Ordering::Relaxed);
                Err(Stopped(WindowErrorKind::Lost))
            }
        }
    }
}

/// A window as seen by a program that stops.
struct MortalWindow {
    window: SimWindow,
    stores: Arc<Stores>,
}

#[derive(Debug)]
struct Stopped(WindowErrorKind);

impl WindowError for Stopped {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

impl MemoryWindow for MortalWindow {
    type Error = Stopped;

    fn size(&self) -> u32 {
        self.window.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Stopped> {
        self.stores.live(0)?;
        let loaded = self.window.load(offset, order);
        loaded.map_err(|error| Stopped(error.kind()))
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Stopped> {
        // Nobody acts on names and statistics: the many stores that empty them count as none.
        let table = layout::vector_entry(2, 0)..layout::vector_entry(2, layout::VECTORS as u32);
        self.stores.live(u32::from(!table.contains(&offset)))?;
        let stored = self.window.store(offset, value, order);
        stored.map_err(|error| Stopped(error.kind()))
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), Stopped> {
        let checked = self.window.check(offset, len);
        checked.map_err(|error| Stopped(error.kind()))
    }
}

thread_local! {
    /// The messages whose handlers were started.
    static HANDLED: RefCell<Vec<u32>> = const { RefCell::new(Vec::new()) };
}

fn handled() -> Vec<u32> {
    HANDLED.with_borrow(Clone::clone)
}

/// A message carries its number and its vector, so that words of two messages do not fit.
fn message(number: u32) -> (Vector, u32) {
    let vector = number % VECTORS;
    (Vector(vector as u8), number << 8 | vector)
}

/// What the program of generation `by` answers.
fn answer(by: u32, data: u32) -> u32 {
    data | by << 24
}

/// Generations of programs: the survivor, the one that stops, the next one on its number.
const SURVIVOR: u32 = 1;
const FORMER: u32 = 2;
const NEXT: u32 = 3;

fn set_vectors<W: MemoryWindow>(
    mailbox: &mut Mailbox<'static, (W, SimDoorbell, CriticalSection), 2>,
    generation: u32,
) -> Result<(), MailboxError> {
    for vector in 0..VECTORS {
        let handle = move |call: &Call<'_>| {
            assert_eq!(message(call.data() >> 8), (call.vector(), call.data()));
            HANDLED.with_borrow_mut(|handled| handled.push(call.data() >> 8));
            answer(generation, call.data())
        };
        let handler = Box::leak(Box::new(handle));
        mailbox.set_vector(Vector(vector as u8), handler, "answers")?;
    }
    Ok(())
}

/// A whole program that runs while the other waits.
fn start(system: &SimSystem<2>, number: Processor, generation: u32) -> Survivor {
    let mut mailbox = system.mailbox(number).unwrap();
    set_vectors(&mut mailbox, generation).unwrap();
    mailbox.join().unwrap();
    let mailbox = &*Box::leak(Box::new(mailbox));
    system.while_waiting(number, || {
        mailbox.serve(Duration::ZERO).unwrap();
    });
    mailbox
}

/// The program that stops; it has not joined.
fn mortal(system: &SimSystem<2>, stores: &Arc<Stores>) -> Result<Mortal, MailboxError> {
    let windows = system.windows(A).map(|Windows { mail, data }| {
        let [mail, data] = [mail, data].map(|window| MortalWindow {
            window,
            stores: Arc::clone(stores),
        });
        Windows { mail, data }
    });
    let mut mailbox = Mailbox::new(A, windows, system.doorbell(A), CriticalSection)?;
    mailbox.set_waiting(Waiting::Sleep);
    set_vectors(&mut mailbox, FORMER)?;
    Ok(mailbox)
}

/// How the stop looks from outside, and what the survivor does before the next program begins.
#[derive(Clone, Copy, Debug)]
struct Case {
    /// The platform knows that the program has ended.
    known: bool,
    serves_between: bool,
    /// Messages before, so that the words of former ones are in the slots.
    warm: u32,
    stores: u32,
}

struct World {
    system: SimSystem<2>,
    stores: Arc<Stores>,
    b: Survivor,
    case: Case,
}

/// A call of the survivor to the program that stops.
type Open = (u32, MessageTicket<'static>);

impl World {
    fn new(case: Case) -> Self {
        HANDLED.take();
        let system = SimSystem::<2>::in_virtual_time(64);
        let b = start(&system, B, SURVIVOR);
        Self {
            system,
            stores: Stores::unlimited(),
            b,
            case,
        }
    }

    /// The program that will stop, connected, some messages after its beginning.
    fn joined(&self) -> Mortal {
        let mut a = mortal(&self.system, &self.stores).unwrap();
        a.join().unwrap();
        for number in 0..self.case.warm {
            let (vector, data) = message(number);
            a.send(B, vector, data, PATIENCE).unwrap();
            self.b.send(A, vector, data, PATIENCE).unwrap();
            self.b.serve(Duration::ZERO).unwrap();
            a.serve(Duration::ZERO).unwrap();
        }
        self.b.serve(Duration::ZERO).unwrap();
        a.serve(Duration::ZERO).unwrap();
        HANDLED.take();
        a
    }

    fn stop_soon(&self) {
        self.stores.stop_after(self.case.stores);
    }

    fn begins(&self, number: u32) -> Open {
        let (vector, data) = message(number);
        (data, self.b.begin(A, vector, data, Duration::ZERO).unwrap())
    }

    /// The survivor calls a program that has stopped.
    fn calls_in_vain(&self) {
        let case = self.case;
        let state = self.b.peer_state(A).unwrap();
        let (vector, data) = message(70);
        let error = self
            .b
            .send_with_reply(A, vector, data, PATIENCE)
            .expect_err("nobody is there to answer");
        let fits = match state {
            PeerState::Dead { .. } => matches!(error, MailboxError::PeerDied { .. }),
            PeerState::Up { .. } => !case.known && matches!(error, MailboxError::Stalled { .. }),
            PeerState::Absent => matches!(error, MailboxError::NotConnected { .. }),
            PeerState::Joining => !case.known && matches!(error, MailboxError::NotConnected { .. }),
        };
        assert!(fits, "{case:?}: {state:?}, {error}");
    }

    /// Both directions work between the survivor and the next program.
    fn call_both_ways(&self, a: Survivor) {
        for number in 100..104 {
            let (vector, data) = message(number);
            for (caller, to, by) in [(a, B, SURVIVOR), (self.b, A, NEXT)] {
                assert_eq!(
                    caller.send_with_reply(to, vector, data, PATIENCE),
                    Ok(answer(by, data)),
                    "{:?}",
                    self.case
                );
            }
        }
    }

    /// What happens from the stop on; `open` are the survivor's calls to the former incarnation.
    fn goes_on(&self, open: Vec<Open>) {
        let case = self.case;
        if case.known {
            self.system.kill(A);
        }
        self.system.stall(A, true);
        if case.serves_between {
            self.b.serve(Duration::ZERO).unwrap();
            self.calls_in_vain();
        }
        let before = handled();
        let once = before.windows(2).all(|pair| pair[0] < pair[1]);
        assert!(once, "once each and in order, {case:?}: {before:?}");

        let a = start(&self.system, A, NEXT);
        self.system.stall(A, false);
        self.call_both_ways(a);
        for (data, mut ticket) in open {
            match ticket.poll() {
                Ok(Some(reply)) => {
                    assert_eq!(reply, answer(FORMER, data), "{case:?}");
                    assert!(before.contains(&(data >> 8)), "{case:?}");
                }
                Err(MailboxError::PeerRestarted { .. }) => {}
                other => panic!("{case:?}: {other:?}"),
            }
        }
        self.call_both_ways(a);
        let tickets: Vec<_> = (0..SLOTS).map(|number| self.begins(110 + number)).collect();
        a.serve(Duration::ZERO).unwrap();
        for (data, mut ticket) in tickets {
            assert_eq!(ticket.poll(), Ok(Some(answer(NEXT, data))), "{case:?}");
        }
        // Nothing that the former program sent, or that was sent to it, is executed now.
        let after = handled().split_off(before.len());
        let late = after.iter().any(|&number| number < 100);
        assert!(!late, "{case:?}: {before:?} {after:?}");
    }
}

/// Stops `operation`, which is given the world, after each number of stores.
fn stop_everywhere(operation: impl Fn(&World) -> Vec<Open>) {
    for (known, serves_between) in [(true, true), (true, false), (false, true), (false, false)] {
        for warm in [0, SLOTS + 1] {
            for stores in 0.. {
                let world = World::new(Case {
                    known,
                    serves_between,
                    warm,
                    stores,
                });
                let open = operation(&world);
                if !world.stores.stopped() {
                    assert!(stores > 2, "the operation stores");
                    break;
                }
                world.goes_on(open);
            }
        }
    }
}

#[test]
fn a_sender_stops() {
    stop_everywhere(|world| {
        let a = world.joined();
        world.stop_soon();
        for number in 50..54 {
            let (vector, data) = message(number);
            // From the stop on everything is an error.
            let _ = a.send(B, vector, data, Duration::ZERO);
        }
        Vec::new()
    });
}

#[test]
fn a_caller_stops() {
    stop_everywhere(|world| {
        let a = world.joined();
        world.stop_soon();
        for number in 50..53 {
            let (vector, data) = message(number);
            let outcome = a.send_with_reply(B, vector, data, PATIENCE);
            assert!(outcome.is_err() || outcome == Ok(answer(SURVIVOR, data)));
        }
        Vec::new()
    });
}

#[test]
fn a_server_stops() {
    stop_everywhere(|world| {
        let a = world.joined();
        world.stop_soon();
        let open = (50..54).map(|number| world.begins(number)).collect();
        let _ = a.serve(Duration::ZERO);
        open
    });
}

#[test]
fn a_server_stops_while_a_call_waits_for_it() {
    stop_everywhere(|world| {
        let a = world.joined();
        let (system, known) = (world.system.clone(), world.case.known);
        let stores = Arc::clone(&world.stores);
        world.system.while_waiting(A, move || {
            let _ = a.serve(Duration::ZERO);
            if known && stores.stopped() {
                system.kill(A);
            }
        });
        world.stop_soon();
        for number in 50..53 {
            let (vector, data) = message(number);
            match world.b.send_with_reply(A, vector, data, PATIENCE) {
                Ok(reply) => assert_eq!(reply, answer(FORMER, data)),
                Err(MailboxError::PeerDied { .. }) if known => {}
                Err(MailboxError::Stalled { .. } | MailboxError::TimedOut { .. }) if !known => {}
                Err(error) => panic!("{:?}: {error}", world.case),
            }
        }
        Vec::new()
    });
}

#[test]
fn a_joiner_stops() {
    stop_everywhere(|world| {
        world.stop_soon();
        let _ = mortal(&world.system, &world.stores).and_then(|mut a| a.join());
        Vec::new()
    });
}

#[test]
fn a_joiner_stops_after_a_former_incarnation() {
    stop_everywhere(|world| {
        let former = world.joined();
        for number in 50..53 {
            let (vector, data) = message(number);
            drop(former.begin(B, vector, data, Duration::ZERO).unwrap());
        }
        let open = (40..43).map(|number| world.begins(number)).collect();
        // Its memory is as it is; nothing is left.
        std::mem::forget(former);
        world.stop_soon();
        let _ = mortal(&world.system, &world.stores).and_then(|mut a| a.join());
        open
    });
}

#[test]
fn a_leaver_stops() {
    stop_everywhere(|world| {
        let mut a = world.joined();
        let (vector, data) = message(50);
        a.send(B, vector, data, Duration::ZERO).unwrap();
        let open = vec![world.begins(51)];
        world.stop_soon();
        let _ = a.leave();
        std::mem::forget(a);
        open
    });
}
