//! Random schedules of three processors, their lives and the faults of their doorbells, against
//! what must have happened, in virtual time.
//!
//! This sees only what programs see: outcomes, handlers and counts. `hostile` watches every word
//! instead, but in a system whose doorbells work and where nobody stalls or is known to be dead.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::{Arc, RwLock};
use std::time::Duration;

use condor_mbox::layout::SLOTS;
use condor_mbox::sim::{Mailbox, System};
use condor_mbox::{Call, Error, Message, Messenger, Pending, Processor, Vector};
use proptest::prelude::*;

const N: usize = 3;
const LONG: Duration = Duration::from_millis(50);
const VECTORS: [Vector; 3] = [Vector(0), Vector(1), Vector(63)];
/// Nobody has a handler for it.
const MISSING: Vector = VECTORS[2];
/// The one processor that listens: requests to be admitted are its own.
const LISTENER: usize = 2;

#[derive(Clone, Debug)]
enum Step {
    TrySend(usize, usize, Vector),
    Send(usize, usize, Vector),
    Begin(usize, usize, Vector),
    Poll(usize),
    GiveUp(usize),
    Service(usize),
    /// Leaves and joins; another one runs in between.
    Rejoin(usize, usize),
    Kill(usize),
    /// A new program takes the number of one that was killed.
    Revive(usize),
    Stall(usize, bool),
    DropRings(usize, u32),
    RepeatRings(usize, u32),
    SpuriousRings(usize, u32),
    Listen(Option<usize>),
}

fn step() -> impl Strategy<Value = Step> {
    let who = || 0..N;
    let message = || (who(), who(), prop::sample::select(&VECTORS[..]));
    prop_oneof![
        8 => message().prop_map(|(from, to, vector)| Step::TrySend(from, to, vector)),
        3 => message().prop_map(|(from, to, vector)| Step::Send(from, to, vector)),
        5 => message().prop_map(|(from, to, vector)| Step::Begin(from, to, vector)),
        4 => who().prop_map(Step::Poll),
        1 => who().prop_map(Step::GiveUp),
        5 => who().prop_map(Step::Service),
        1 => (who(), who()).prop_map(|(who, other)| Step::Rejoin(who, other)),
        1 => who().prop_map(Step::Kill),
        1 => who().prop_map(Step::Revive),
        1 => (who(), any::<bool>()).prop_map(|(who, on)| Step::Stall(who, on)),
        1 => (who(), 1..4_u32).prop_map(|(who, count)| Step::DropRings(who, count)),
        1 => (who(), 1..4_u32).prop_map(|(who, count)| Step::RepeatRings(who, count)),
        1 => (who(), 1..4_u32).prop_map(|(who, count)| Step::SpuriousRings(who, count)),
        1 => prop::option::of(0..LISTENER).prop_map(Step::Listen),
    ]
}

/// A message as a handler of `me` saw it.
struct Heard {
    me: usize,
    from: usize,
    to: usize,
    vector: Vector,
    data: u32,
}

thread_local! {
    static HEARD: RefCell<Vec<Heard>> = const { RefCell::new(Vec::new()) };
}

const fn reply_to(data: u32) -> u32 {
    data.wrapping_mul(3) + 1
}

fn handle<const ME: usize>(call: &Call<'_>) -> u32 {
    HEARD.with_borrow_mut(|heard| {
        heard.push(Heard {
            me: ME,
            from: call.sender().index(),
            to: call.addressee().index(),
            vector: call.vector(),
            data: call.data(),
        });
    });
    reply_to(call.data())
}

/// A message that was offered; its data is its index.
struct Offer {
    from: usize,
    to: usize,
    vector: Vector,
    from_life: u32,
    to_life: u32,
    handled: bool,
    /// A call whose ticket is not spent.
    is_open: bool,
    is_call: bool,
}

/// What the listener must hear.
struct Hearing {
    to: usize,
    expected: [VecDeque<u32>; N],
    /// Messages of each sender that must have been counted as missed.
    missed: [u32; N],
    /// Those that may have been: without a handler, or of a life that is over.
    perhaps: [u32; N],
}

impl Hearing {
    fn skip(&mut self, from: usize, has_handler: bool) {
        let count = if has_handler {
            &mut self.missed
        } else {
            &mut self.perhaps
        };
        count[from] += 1;
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    sent: u32,
    handled: u32,
    failed: u32,
}

type Shared = Arc<RwLock<Mailbox<'static, N>>>;

/// One number: its program, and what is true of its present life.
struct Seat {
    mailbox: Shared,
    life: u32,
    dead: bool,
    stalled: bool,
    tickets: Vec<(u32, Pending)>,
    counts: [Counts; VECTORS.len()],
    /// To whom a message of this life has entered the ring in that one's present life.
    connected: [bool; N],
}

struct World {
    system: System<N>,
    seats: Vec<Seat>,
    /// Programs that were killed: their mailboxes must not be dropped before the end.
    graves: Vec<Shared>,
    offers: Vec<Offer>,
    /// Sent and not handled, from each sender to each receiver.
    rings: [[VecDeque<u32>; N]; N],
    hearing: Option<Hearing>,
}

fn number(index: usize) -> Processor {
    Processor(index as u8)
}

fn row(vector: Vector) -> usize {
    VECTORS.iter().position(|known| *known == vector).unwrap()
}

fn program(system: &System<N>, who: usize) -> Shared {
    let mut mailbox = system.mailbox(number(who)).unwrap();
    for vector in [VECTORS[0], VECTORS[1]] {
        let handler: condor_mbox::Handler<'static> = match who {
            0 => &handle::<0>,
            1 => &handle::<1>,
            _ => &handle::<2>,
        };
        mailbox.set_vector(vector, handler, "notes").unwrap();
    }
    mailbox.join().unwrap();
    let mailbox = Arc::new(RwLock::new(mailbox));
    let own = Arc::clone(&mailbox);
    system.while_waiting(number(who), move || {
        own.read().unwrap().service(LONG).unwrap();
    });
    mailbox
}

impl World {
    fn new() -> Self {
        HEARD.take();
        let system = System::in_virtual_time(0);
        let seats = (0..N).map(|who| Seat {
            mailbox: program(&system, who),
            life: 1,
            dead: false,
            stalled: false,
            tickets: Vec::new(),
            counts: Default::default(),
            connected: [false; N],
        });
        Self {
            seats: seats.collect(),
            system,
            graves: Vec::new(),
            offers: Vec::new(),
            rings: Default::default(),
            hearing: None,
        }
    }

    /// Whether the program of `who` can do anything now.
    fn runs(&self, who: usize) -> bool {
        !self.seats[who].dead && !self.seats[who].stalled
    }

    fn step(&mut self, step: &Step) {
        match *step {
            Step::TrySend(from, to, vector) if self.runs(from) => self.try_send(from, to, vector),
            Step::Send(from, to, vector) if self.runs(from) => self.send(from, to, vector),
            Step::Begin(from, to, vector) if self.runs(from) => self.begin(from, to, vector),
            Step::Poll(who) if self.runs(who) => self.poll(who),
            Step::GiveUp(who) if self.runs(who) => self.give_up(who),
            Step::Service(who) => drop(self.service(who)),
            Step::Rejoin(who, other) if self.runs(who) => {
                self.seats[who].mailbox.write().unwrap().leave().unwrap();
                if other != who {
                    self.service(other);
                }
                self.seats[who].mailbox.write().unwrap().join().unwrap();
                self.new_life(who);
            }
            Step::Kill(who) => {
                self.seats[who].dead = true;
                self.system.kill(number(who));
            }
            Step::Revive(who) if self.seats[who].dead => self.revive(who),
            Step::Stall(who, stalled) => {
                self.seats[who].stalled = stalled;
                self.system.stall(number(who), stalled);
            }
            Step::DropRings(who, count) => self.system.drop_rings(number(who), count),
            Step::RepeatRings(who, count) => self.system.repeat_rings(number(who), count),
            Step::SpuriousRings(who, count) => self.system.spurious_rings(number(who), count),
            Step::Listen(to) if self.runs(LISTENER) => self.listen(to),
            _ => {}
        }
        self.check_heard();
    }

    fn new_life(&mut self, who: usize) {
        self.check_heard();
        for other in 0..N {
            self.rings[who][other].clear();
            self.rings[other][who].clear();
            self.seats[who].connected[other] = false;
            self.seats[other].connected[who] = false;
        }
        let seat = &mut self.seats[who];
        seat.life += 1;
        seat.tickets.clear();
        if who == LISTENER {
            self.hearing = None;
        }
        if let Some(hearing) = &mut self.hearing {
            let holder = hearing.to == who;
            for (from, expected) in hearing.expected.iter_mut().enumerate() {
                if holder || from == who {
                    hearing.perhaps[from] += expected.len() as u32;
                    expected.clear();
                }
            }
        }
    }

    fn revive(&mut self, who: usize) {
        let mailbox = program(&self.system, who);
        self.new_life(who);
        let seat = &mut self.seats[who];
        self.graves.push(std::mem::replace(&mut seat.mailbox, mailbox));
        seat.dead = false;
        seat.counts = Default::default();
    }

    fn offer(&mut self, from: usize, to: usize, vector: Vector, is_call: bool) -> Message {
        let data = self.offers.len() as u32;
        self.offers.push(Offer {
            from,
            to,
            vector,
            from_life: self.seats[from].life,
            to_life: self.seats[to].life,
            handled: false,
            is_open: is_call,
            is_call,
        });
        let to = number(to);
        Message { to, vector, data }
    }

    /// Notes how sending ended; what handlers saw until then came before this message.
    fn sent(&mut self, from: usize, message: Message, outcome: Result<(), Error>) {
        self.check_heard();
        let to = message.to.index();
        let is_call = self.offers[message.data as usize].is_open;
        let counts = &mut self.seats[from].counts[row(message.vector)];
        match outcome {
            Ok(()) => {
                counts.sent += 1;
                self.seats[from].connected[to] = true;
                self.rings[from][to].push_back(message.data);
                if let Some(hearing) = &mut self.hearing
                    && hearing.to == to
                {
                    hearing.expected[from].push_back(message.data);
                }
            }
            Err(error) => {
                counts.failed += 1;
                let offer = &mut self.offers[message.data as usize];
                (offer.is_open, offer.is_call) = (false, false);
                self.check_refusal(from, to, is_call, error);
            }
        }
    }

    fn check_refusal(&self, from: usize, to: usize, is_call: bool, error: Error) {
        match error {
            Error::NotConnected { .. } => assert!(!self.seats[from].connected[to] && from != to),
            Error::NoSlot { .. } => {
                let full = self.rings[from][to].len() >= SLOTS as usize;
                let unanswered = self.unanswered(from, to) >= SLOTS as usize;
                // Its requests to be admitted take slots, too.
                assert!(full || is_call && unanswered || from == LISTENER);
            }
            Error::Stalled { .. } => assert!(self.seats[to].stalled),
            Error::PeerDied { .. } => assert!(self.seats[to].dead),
            _ => panic!("{error}"),
        }
    }
}

impl World {
    fn try_send(&mut self, from: usize, to: usize, vector: Vector) {
        let message = self.offer(from, to, vector, false);
        let outcome = self.mailbox(from).read().unwrap().post(message);
        self.sent(from, message, outcome);
    }

    /// To whoever can receive it must get there.
    fn send(&mut self, from: usize, to: usize, vector: Vector) {
        let message = self.offer(from, to, vector, false);
        let mailbox = self.mailbox(from);
        let sent = mailbox
            .read()
            .unwrap()
            .send(message.to, vector, message.data, LONG);
        assert!(sent.is_ok() || !self.runs(to), "{sent:?}");
        self.sent(from, message, sent);
    }

    fn begin(&mut self, from: usize, to: usize, vector: Vector) {
        let message = self.offer(from, to, vector, true);
        let opened = self.mailbox(from).read().unwrap().open(message);
        self.sent(from, message, opened.map(drop));
        if let Ok(pending) = opened {
            self.seats[from].tickets.push((message.data, pending));
        }
    }

    /// Looks at each call in progress, as tickets do.
    fn poll(&mut self, who: usize) {
        let mailbox = self.mailbox(who);
        let mailbox = mailbox.read().unwrap();
        let tickets = std::mem::take(&mut self.seats[who].tickets);
        for (data, pending) in tickets {
            let Offer {
                to,
                vector,
                to_life,
                handled,
                ..
            } = self.offers[data as usize];
            let outcome = mailbox.look(&pending);
            match outcome {
                _ if self.seats[to].life != to_life => {
                    let to = number(to);
                    assert!(
                        matches!(outcome, Err(Error::PeerRestarted { to: of, .. }) if of == to)
                    );
                }
                Ok(Some(reply)) => assert!(handled && reply == reply_to(data)),
                Err(Error::NoHandler { .. }) => assert_eq!(vector, MISSING),
                Ok(None) => {
                    assert!(!handled);
                    self.seats[who].tickets.push((data, pending));
                    continue;
                }
                Err(error) => panic!("{error}"),
            }
            mailbox.abandon(&pending);
            if outcome.is_err() {
                self.seats[who].counts[row(vector)].failed += 1;
            }
            self.offers[data as usize].is_open = false;
        }
    }

    fn give_up(&mut self, who: usize) {
        if let Some((data, pending)) = self.seats[who].tickets.pop() {
            self.mailbox(who).read().unwrap().abandon(&pending);
            self.offers[data as usize].is_open = false;
        }
    }

    fn service(&mut self, who: usize) -> usize {
        if !self.runs(who) {
            return 0;
        }
        let served = self.mailbox(who).read().unwrap().service(LONG).unwrap();
        self.check_heard();
        served
    }

    fn listen(&mut self, to: Option<usize>) {
        let mailbox = self.mailbox(LISTENER);
        let outcome = mailbox.write().unwrap().listen(to.map(number), LONG);
        self.check_heard();
        match outcome {
            Ok(()) => {
                // What the holder has not taken by now is heard.
                self.hearing = to.map(|to| Hearing {
                    to,
                    expected: std::array::from_fn(|from| self.rings[from][to].clone()),
                    missed: [0; N],
                    perhaps: [0; N],
                });
            }
            Err(error) => {
                assert!(to.is_some_and(|to| !self.runs(to)), "{error}");
                self.hearing = None;
            }
        }
    }

    /// Calls of `from` to `to` that may occupy reply cells.
    fn unanswered(&self, from: usize, to: usize) -> usize {
        let lives = (self.seats[from].life, self.seats[to].life);
        let calls = self.offers.iter().filter(|offer| offer.is_call);
        calls
            .filter(|offer| (offer.from, offer.to) == (from, to))
            .filter(|offer| (offer.from_life, offer.to_life) == lives)
            .filter(|offer| offer.is_open || !offer.handled)
            .count()
    }

    fn mailbox(&self, who: usize) -> Shared {
        Arc::clone(&self.seats[who].mailbox)
    }

    /// Checks what handlers saw since the last time.
    fn check_heard(&mut self) {
        for heard in HEARD.take() {
            let Heard {
                me, from, to, data, ..
            } = heard;
            let offer = &mut self.offers[data as usize];
            assert_eq!(
                (from, to, heard.vector),
                (offer.from, offer.to, offer.vector)
            );
            self.seats[me].counts[row(heard.vector)].handled += 1;
            let expected = if me == to {
                offer.handled = true;
                &mut self.rings[from][to]
            } else {
                let hearing = self.hearing.as_mut().expect("nobody listens");
                assert_eq!((hearing.to, LISTENER), (to, me));
                &mut hearing.expected[from]
            };
            // Not in it: from another life, or a second time, or after a later one.
            let before = expected.iter().position(|next| *next == data);
            let before = before.unwrap_or_else(|| panic!("{me} got {data} of {from} to {to}"));
            let skipped: Vec<_> = expected.drain(..=before).take(before).collect();
            for data in skipped {
                let has_handler = self.offers[data as usize].vector != MISSING;
                if me == to {
                    assert!(!has_handler, "{me} got a later one than {data} of {from}");
                } else if let Some(hearing) = &mut self.hearing {
                    hearing.skip(from, has_handler);
                }
            }
        }
    }

    /// Heals every fault and lets everybody run until nothing is left, which must be everything.
    fn settle(&mut self) {
        for who in 0..N {
            self.step(&Step::DropRings(who, 0));
            self.step(&Step::Stall(who, false));
            self.step(&Step::Revive(who));
        }
        // The second round, if not the first, finds everybody connected.
        self.drain();
        self.drain();
        for from in 0..N {
            for to in 0..N {
                self.try_send(from, to, VECTORS[0]);
                self.begin(from, to, MISSING);
                assert!(self.seats[from].connected[to], "{from} to {to}");
            }
        }
        self.drain();
        for who in 0..N {
            self.poll(who);
            assert!(self.seats[who].tickets.is_empty());
        }
        for data in self.rings.iter().flatten().flatten() {
            assert_eq!(self.offers[*data as usize].vector, MISSING, "{data} is lost");
        }
        self.check_missed();
        for who in 0..N {
            self.check_counts(who);
            // Breaks the circle of the system, the program and its mailbox.
            self.system.kill(number(who));
        }
    }

    fn drain(&mut self) {
        while (0..N).map(|who| self.service(who)).sum::<usize>() > 0 {}
    }

    fn check_missed(&mut self) {
        let Some(mut hearing) = self.hearing.take() else {
            return;
        };
        let mailbox = self.mailbox(LISTENER);
        for from in 0..N {
            for data in std::mem::take(&mut hearing.expected[from]) {
                hearing.skip(from, self.offers[data as usize].vector != MISSING);
            }
            let counted = mailbox.read().unwrap().missed(number(from)).unwrap();
            let (least, perhaps) = (hearing.missed[from], hearing.perhaps[from]);
            assert!(counted >= least, "{counted} of {least} are known");
            // Its own requests to be admitted count, too.
            assert!(counted <= least + perhaps || from == LISTENER);
        }
    }

    /// Everybody sees the counts of `who`, exactly.
    fn check_counts(&self, who: usize) {
        let observer = self.mailbox((who + 1) % N);
        for (vector, expected) in VECTORS.iter().zip(self.seats[who].counts) {
            let observer = observer.read().unwrap();
            let found = observer.vector_statistics(number(who), *vector).unwrap();
            let counts = Counts {
                sent: found.sent,
                handled: found.handled,
                failed: found.failed,
            };
            assert_eq!(counts, expected, "{who} {vector}");
        }
    }
}

fn longest() -> usize {
    if cfg!(miri) { 20 } else { 120 }
}

fn config() -> ProptestConfig {
    ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::with_cases(if cfg!(miri) { 2 } else { 256 })
    }
}

proptest! {
    #![proptest_config(config())]
    #[test]
    fn every_schedule_keeps_the_promises(steps in prop::collection::vec(step(), 1..longest())) {
        let mut world = World::new();
        for step in &steps {
            world.step(step);
        }
        world.settle();
    }
}
