//! Three processors in virtual time, what they do, and what is known of it.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::{Arc, RwLock};
use std::time::Duration;

use condor_mbox::sim::{SimMailbox, SimSystem};
use condor_mbox::{Call, Handler, MailboxError, Messenger, PendingReply, Processor, Vector};

use super::{LISTENER, MISSING, N, Step, VECTORS};

/// Enough for any wait that nobody's fault prolongs.
const LONG: Duration = Duration::from_millis(50);

/// A message as a handler of `me` saw it.
pub(super) struct Heard {
    pub(super) me: usize,
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) vector: Vector,
    pub(super) data: u32,
}

thread_local! {
    pub(super) static HEARD: RefCell<Vec<Heard>> = const { RefCell::new(Vec::new()) };
}

pub(super) const fn reply_to(data: u32) -> u32 {
    data.wrapping_mul(3) + 1
}

pub(super) fn handle<const ME: usize>(call: &Call<'_>) -> u32 {
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
pub(super) struct Offer {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) vector: Vector,
    pub(super) from_incarnation: u32,
    pub(super) to_incarnation: u32,
    pub(super) handled: bool,
    /// A call whose ticket is not spent.
    pub(super) is_open: bool,
    pub(super) is_call: bool,
}

/// What the listener must hear.
pub(super) struct Hearing {
    pub(super) to: usize,
    pub(super) expected: [VecDeque<u32>; N],
    /// Messages of each sender that must have been counted as missed.
    pub(super) missed: [u32; N],
    /// Those that may have been: without a handler of the holder, which may have taken them before, or of an incarnation that is over.
    pub(super) perhaps: [u32; N],
}

impl Hearing {
    pub(super) fn skip(&mut self, from: usize, has_handler: bool) {
        let count = if has_handler {
            &mut self.missed
        } else {
            &mut self.perhaps
        };
        count[from] += 1;
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) sent: u32,
    pub(super) handled: u32,
    pub(super) failed: u32,
}

pub(super) type Shared = Arc<RwLock<SimMailbox<'static, N>>>;

/// One number: its program, and what is true of its present incarnation.
pub(super) struct Seat {
    pub(super) mailbox: Shared,
    pub(super) incarnation: u32,
    pub(super) dead: bool,
    pub(super) stalled: bool,
    pub(super) tickets: Vec<(u32, PendingReply)>,
    pub(super) counts: [Counts; VECTORS.len()],
    /// To whom a message of this incarnation has entered the ring in that one's present incarnation.
    pub(super) connected: [bool; N],
}

pub(super) struct World {
    pub(super) system: SimSystem<N>,
    pub(super) seats: Vec<Seat>,
    /// Programs that were killed: their mailboxes must not be dropped before the end.
    pub(super) graves: Vec<Shared>,
    pub(super) offers: Vec<Offer>,
    /// Sent and not handled, from each sender to each receiver.
    pub(super) rings: [[VecDeque<u32>; N]; N],
    pub(super) hearing: Option<Hearing>,
}

pub(super) fn number(index: usize) -> Processor {
    Processor(index as u8)
}

pub(super) fn row(vector: Vector) -> usize {
    VECTORS.iter().position(|known| *known == vector).unwrap()
}

pub(super) fn program(system: &SimSystem<N>, who: usize) -> Shared {
    let mut mailbox = system.mailbox(number(who)).unwrap();
    let handler: Handler<'static> = match who {
        0 => &handle::<0>,
        1 => &handle::<1>,
        _ => &handle::<2>,
    };
    mailbox.set_listener(handler);
    for vector in [VECTORS[0], VECTORS[1]] {
        mailbox.set_vector(vector, handler, "notes").unwrap();
    }
    mailbox.join().unwrap();
    let mailbox = Arc::new(RwLock::new(mailbox));
    let own = Arc::clone(&mailbox);
    system.while_waiting(number(who), move || {
        own.read().unwrap().serve(Duration::ZERO).unwrap();
    });
    mailbox
}

/// A message to be sent.
#[derive(Clone, Copy)]
pub(super) struct Message {
    pub(super) to: Processor,
    pub(super) vector: Vector,
    pub(super) data: u32,
}

impl World {
    pub(super) fn new() -> Self {
        HEARD.take();
        let system = SimSystem::in_virtual_time(0);
        let seats = (0..N).map(|who| Seat {
            mailbox: program(&system, who),
            incarnation: 1,
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

    pub(super) fn step(&mut self, step: &Step) {
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
                self.new_incarnation(who);
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

    pub(super) fn new_incarnation(&mut self, who: usize) {
        self.check_heard();
        for other in 0..N {
            self.rings[who][other].clear();
            self.rings[other][who].clear();
            self.seats[who].connected[other] = false;
            self.seats[other].connected[who] = false;
        }
        let seat = &mut self.seats[who];
        seat.incarnation += 1;
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
        self.new_incarnation(who);
        let seat = &mut self.seats[who];
        self.graves
            .push(std::mem::replace(&mut seat.mailbox, mailbox));
        seat.dead = false;
        seat.counts = Default::default();
    }

    fn offer(&mut self, from: usize, to: usize, vector: Vector, is_call: bool) -> Message {
        let data = self.offers.len() as u32;
        self.offers.push(Offer {
            from,
            to,
            vector,
            from_incarnation: self.seats[from].incarnation,
            to_incarnation: self.seats[to].incarnation,
            handled: false,
            is_open: is_call,
            is_call,
        });
        let to = number(to);
        Message { to, vector, data }
    }

    /// Notes how sending ended; what handlers saw until then came before this message.
    fn sent(&mut self, from: usize, message: Message, outcome: Result<(), MailboxError>) {
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

    pub(super) fn try_send(&mut self, from: usize, to: usize, vector: Vector) {
        let message = self.offer(from, to, vector, false);
        let outcome = self.mailbox(from).read().unwrap().send(
            message.to,
            message.vector,
            message.data,
            Duration::ZERO,
        );
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

    pub(super) fn begin(&mut self, from: usize, to: usize, vector: Vector) {
        let message = self.offer(from, to, vector, true);
        let mailbox = self.mailbox(from);
        let mailbox = mailbox.read().unwrap();
        let opened = mailbox
            .begin(message.to, message.vector, message.data, Duration::ZERO)
            .map(|ticket| ticket.detach().expect("it was not looked at"));
        self.sent(from, message, opened.map(drop));
        if let Ok(pending) = opened {
            self.seats[from].tickets.push((message.data, pending));
        }
    }

    /// Looks at each call in progress, as tickets do.
    pub(super) fn poll(&mut self, who: usize) {
        let mailbox = self.mailbox(who);
        let mailbox = mailbox.read().unwrap();
        let tickets = std::mem::take(&mut self.seats[who].tickets);
        for (data, pending) in tickets {
            let Offer {
                to,
                vector,
                to_incarnation,
                handled,
                ..
            } = self.offers[data as usize];
            let outcome = mailbox.poll_pending(&pending);
            match outcome {
                _ if self.seats[to].incarnation != to_incarnation => {
                    let to = number(to);
                    assert!(
                        matches!(outcome, Err(MailboxError::PeerRestarted { to: of, .. }) if of == to)
                    );
                }
                Ok(Some(reply)) => assert!(handled && reply == reply_to(data)),
                Err(MailboxError::NoHandler { .. }) => assert_eq!(vector, MISSING),
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

    pub(super) fn service(&mut self, who: usize) -> usize {
        if !self.runs(who) {
            return 0;
        }
        let served = self
            .mailbox(who)
            .read()
            .unwrap()
            .serve(Duration::ZERO)
            .unwrap();
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

    pub(super) fn mailbox(&self, who: usize) -> Shared {
        Arc::clone(&self.seats[who].mailbox)
    }
}
