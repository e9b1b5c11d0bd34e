//! An interrupt at every shared access of what a processor's background does.
//!
//! The windows of one mailbox count its loads and stores, and run an interrupt routine that uses the
//! same mailbox before the k-th of them, for every k that the operation reaches. Sections mask it.
//!
//! It fails without the section around the publishing of a request, its taking, the end of its
//! handler or the acknowledgement of a new incarnation, and if a reply cell is not released when its
//! reply has come or its ticket was dropped.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use condor_mbox::layout::SLOTS;
use condor_mbox::sim::{SimDoorbell, SimMailbox, SimSystem, SimWindow};
use condor_mbox::{
    AccessError, Call, Exclusion, LoadOrder, Mailbox, MailboxError, MemoryWindow, Messenger,
    Processor, StoreOrder, Vector, Waiting, Windows,
};

const A: Processor = Processor(0);
const B: Processor = Processor(1);
const C: Processor = Processor(2);
const ALL: [Processor; 3] = [A, B, C];
const V: Vector = Vector(5);
const SECOND: Duration = Duration::from_secs(1);

type Interrupted = Mailbox<'static, (Counted, SimDoorbell, Mask), 3>;

/// The interrupt of the processor that this thread plays.
#[derive(Default)]
struct Interrupt {
    /// Accesses until it comes; 0 while it is not to come.
    left: Cell<u32>,
    masked: Cell<bool>,
    pending: Cell<bool>,
    running: Cell<bool>,
    routine: RefCell<Option<Rc<dyn Fn()>>>,
}

/// A message that was sent, and when.
#[derive(Clone, Copy, Debug)]
struct Sent {
    from: Processor,
    to: Processor,
    data: u32,
    begun: u32,
    ended: u32,
}

/// A message that a handler was started for.
#[derive(Clone, Copy, Debug)]
struct Handled {
    by: Processor,
    from: Processor,
    data: u32,
    in_interrupt: bool,
}

/// What happened in this thread since the latest check.
#[derive(Default)]
struct Journal {
    time: Cell<u32>,
    messages: Cell<u32>,
    sent: RefCell<Vec<Sent>>,
    handled: RefCell<Vec<Handled>>,
    /// What the statistics of the vector must say.
    totals: [Totals; 3],
}

#[derive(Default)]
struct Totals {
    sent: Cell<u32>,
    handled: Cell<u32>,
    failed: Cell<u32>,
}

impl Totals {
    fn clear(&self) {
        for count in [&self.sent, &self.handled, &self.failed] {
            count.set(0);
        }
    }
}

thread_local! {
    static INTERRUPT: Interrupt = Interrupt::default();
    static JOURNAL: Journal = Journal::default();
}

fn increment(count: &Cell<u32>) -> u32 {
    count.set(count.get() + 1);
    count.get()
}

impl Interrupt {
    /// Lets the interrupt come at the `k`-th access; says whether `operation` reached it.
    fn comes_in(k: u32, routine: Rc<dyn Fn()>, operation: impl FnOnce()) -> bool {
        INTERRUPT.with(|this| {
            *this.routine.borrow_mut() = Some(routine);
            this.left.set(k);
        });
        operation();
        INTERRUPT.with(|this| {
            assert!(!this.masked.get() && !this.pending.get());
            this.left.replace(0) == 0
        })
    }

    fn access(&self) {
        let left = self.left.get();
        if self.running.get() || left == 0 {
            return;
        }
        self.left.set(left - 1);
        if left > 1 {
            return;
        }
        if self.masked.get() {
            self.pending.set(true);
        } else {
            self.run();
        }
    }

    fn run(&self) {
        let routine = self.routine.borrow_mut().take().expect("comes once");
        self.running.set(true);
        routine();
        self.running.set(false);
    }
}

/// Keeps the interrupt out; what came meanwhile comes at the end.
struct Mask;

impl Exclusion for Mask {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        INTERRUPT.with(|interrupt| {
            assert!(!interrupt.masked.replace(true), "sections do not nest");
            let result = body();
            interrupt.masked.set(false);
            if interrupt.pending.replace(false) {
                interrupt.run();
            }
            result
        })
    }
}

/// A window whose accesses the interrupt waits for.
struct Counted(SimWindow);

impl MemoryWindow for Counted {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.0.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        INTERRUPT.with(Interrupt::access);
        self.0.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        INTERRUPT.with(Interrupt::access);
        self.0.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.0.check(offset, len)
    }
}

/// Sends a new message and notes it.
fn note<T>(
    from: Processor,
    to: Processor,
    send: impl FnOnce(u32) -> Result<T, MailboxError>,
) -> Option<(u32, T)> {
    JOURNAL.with(|journal| {
        let data = increment(&journal.messages);
        let begun = increment(&journal.time);
        let outcome = send(data);
        let totals = &journal.totals[from.index()];
        match outcome {
            Ok(value) => {
                let ended = increment(&journal.time);
                let message = Sent {
                    from,
                    to,
                    data,
                    begun,
                    ended,
                };
                journal.sent.borrow_mut().push(message);
                increment(&totals.sent);
                Some((data, value))
            }
            Err(MailboxError::NoSlot { .. }) => {
                increment(&totals.failed);
                None
            }
            Err(error) => panic!("{from} to {to}: {error}"),
        }
    })
}

fn handle(by: Processor, call: &Call<'_>) -> u32 {
    let in_interrupt = by == A && INTERRUPT.with(|interrupt| interrupt.running.get());
    JOURNAL.with(|journal| {
        increment(&journal.totals[by.index()].handled);
        journal.handled.borrow_mut().push(Handled {
            by,
            from: call.sender(),
            data: call.data(),
            in_interrupt,
        });
    });
    answer(by, call.data())
}

/// No two messages have the same one.
fn answer(by: Processor, data: u32) -> u32 {
    data * 4 + u32::from(by.0)
}

/// Three processors; the first is the one that is interrupted.
struct World {
    system: SimSystem<3>,
    a: &'static Interrupted,
    b: Cell<&'static SimMailbox<'static, 3>>,
    c: &'static SimMailbox<'static, 3>,
}

impl World {
    fn new() -> Rc<Self> {
        JOURNAL.with(|journal| journal.totals.iter().for_each(Totals::clear));
        let system = SimSystem::<3>::in_virtual_time(64);
        let counted = |Windows { mail, data }| Windows {
            mail: Counted(mail),
            data: Counted(data),
        };
        let windows = system.windows(A).map(counted);
        let mut a = Mailbox::new(A, windows, system.doorbell(A), Mask).unwrap();
        a.set_waiting(Waiting::Sleep);
        a.set_vector(V, &|call| handle(A, call), "a").unwrap();
        a.join().unwrap();
        let a = &*Box::leak(Box::new(a));
        let b = Cell::new(start(&system, B));
        let c = start(&system, C);
        let world = Self { system, a, b, c };
        world.settle();
        Rc::new(world)
    }

    /// Everybody notices everybody, and serves what there is.
    fn settle(&self) {
        for _ in 0..3 {
            self.a.serve(Duration::ZERO).unwrap();
            self.b.get().serve(Duration::ZERO).unwrap();
            self.c.serve(Duration::ZERO).unwrap();
        }
    }

    /// A new program takes over B's number, and acknowledges the others.
    fn restart_b(&self) {
        self.system.kill(B);
        self.b.set(start(&self.system, B));
        // Its statistics begin anew.
        JOURNAL.with(|journal| journal.totals[B.index()].clear());
        self.b.get().serve(Duration::ZERO).unwrap();
    }

    fn a_posts(&self, to: Processor) {
        note(A, to, |data| self.a.send(to, V, data, Duration::ZERO));
    }

    fn a_sends(&self, to: Processor) {
        note(A, to, |data| self.a.send(to, V, data, SECOND)).unwrap();
    }

    fn a_calls(&self, to: Processor) {
        let call = |data| self.a.send_with_reply(to, V, data, SECOND);
        let (data, reply) = note(A, to, call).unwrap();
        assert_eq!(reply, answer(to, data));
    }

    /// One ticket that is given up, and one that is answered; a receiver that has not noticed the
    /// mailbox yet answers none.
    fn a_polls(&self, to: Processor) {
        let begin = || note(A, to, |data| self.a.begin(to, V, data, Duration::ZERO));
        if let Some((data, mut ticket)) = begin() {
            let polled = ticket.poll().unwrap();
            assert!(polled.is_none_or(|reply| reply == answer(to, data)));
        }
        if let Some((data, mut ticket)) = begin() {
            self.b.get().serve(Duration::ZERO).unwrap();
            assert_eq!(ticket.poll(), Ok(Some(answer(to, data))));
        }
    }

    /// Requests that wait for A, and the answers that their senders wait for.
    fn others_post(&self, senders: &[Processor]) {
        for &from in senders {
            let sender = if from == B { self.b.get() } else { self.c };
            note(from, A, |data| sender.send(A, V, data, Duration::ZERO)).unwrap();
            note(from, A, |data| {
                sender.begin(A, V, data, Duration::ZERO).map(drop)
            })
            .unwrap();
            note(from, A, |data| sender.send(A, V, data, Duration::ZERO)).unwrap();
        }
    }

    /// Everything that was sent was handled once, in order, and is counted; all goes on.
    fn check(&self, what: &str) {
        self.settle();
        JOURNAL.with(|journal| {
            let sent = journal.sent.take();
            let handled = journal.handled.take();
            let position = |data| handled.iter().position(|h| h.data == data).expect(what);
            for sent in &sent {
                let found = handled[position(sent.data)];
                assert_eq!((found.from, found.by), (sent.from, sent.to), "{what}");
            }
            assert_eq!(sent.len(), handled.len(), "once each, {what}: {handled:?}");
            let mut overtaken = Vec::new();
            for first in &sent {
                for second in &sent {
                    let ordered = first.ended < second.begun;
                    if !ordered || (first.from, first.to) != (second.from, second.to) {
                        continue;
                    }
                    let [one, two] = [first, second].map(|sent| position(sent.data));
                    // The interrupt may come between the taking of a message and the first
                    // instruction of its handler.
                    if one > two && handled[two].in_interrupt && !handled[one].in_interrupt {
                        overtaken.push(first.data);
                    } else {
                        assert!(one < two, "{what}: {first:?} {second:?} {handled:?}");
                    }
                }
            }
            overtaken.dedup();
            assert!(overtaken.len() <= 1, "{what}: {overtaken:?}");
            for (processor, totals) in ALL.into_iter().zip(&journal.totals) {
                let found = self.a.vector_statistics(processor, V).unwrap();
                assert_eq!(
                    (found.sent, found.handled, found.failed),
                    (totals.sent.get(), totals.handled.get(), totals.failed.get()),
                    "sent, handled, failed of {processor}, {what}"
                );
            }
        });
    }

    /// No reply cell was lost: as many calls as ever can be open at once.
    fn open_all(&self, what: &str) {
        for to in ALL {
            let begin =
                |_| note(A, to, |data| self.a.begin(to, V, data, Duration::ZERO)).expect(what);
            let tickets: Vec<_> = (0..SLOTS).map(begin).collect();
            self.settle();
            for (data, mut ticket) in tickets {
                assert_eq!(ticket.poll(), Ok(Some(answer(to, data))), "{what}");
            }
        }
    }
}

/// A program that runs while others wait.
fn start(system: &SimSystem<3>, number: Processor) -> &'static SimMailbox<'static, 3> {
    let mut mailbox = system.mailbox(number).unwrap();
    let handler = move |call: &Call<'_>| handle(number, call);
    mailbox
        .set_vector(V, Box::leak(Box::new(handler)), "peer")
        .unwrap();
    mailbox.join().unwrap();
    let mailbox = &*Box::leak(Box::new(mailbox));
    system.while_waiting(number, || {
        mailbox.serve(Duration::ZERO).unwrap();
    });
    mailbox
}

type Step = fn(&World);

/// What an interrupt does.
const ROUTINES: [(&str, Step); 6] = [
    ("service", |world| {
        world.a.serve(Duration::ZERO).unwrap();
    }),
    ("posts to B", |world| {
        world.a_posts(B);
        world.a_posts(B);
    }),
    ("posts to C", |world| world.a_posts(C)),
    ("polls", |world| world.a_polls(B)),
    ("calls itself", |world| world.a_calls(A)),
    ("everything", |world| {
        world.a_posts(B);
        world.a.serve(Duration::ZERO).unwrap();
        world.a_polls(B);
        world.a_posts(A);
        world.a_calls(A);
        world.a_posts(C);
    }),
];

/// Interrupts `operation` at each of its accesses by each of the routines.
fn interrupt_everywhere(senders: &[Processor], prepare: Step, operation: Step) {
    for (name, routine) in ROUTINES {
        let world = World::new();
        let mut k = 0;
        loop {
            k += 1;
            let what = format!("{name} at access {k}");
            prepare(&world);
            world.others_post(senders);
            let interrupt = {
                let world = Rc::clone(&world);
                Rc::new(move || routine(&world))
            };
            let came = Interrupt::comes_in(k, interrupt, || operation(&world));
            world.check(&what);
            world.a_calls(B);
            world.open_all(&what);
            world.check(&what);
            if !came {
                break;
            }
        }
        assert!(k > 10, "the operation has shared accesses");
    }
}

fn nothing(_: &World) {}

#[test]
fn three_messages_are_posted() {
    interrupt_everywhere(&[B, C], nothing, |world| {
        world.a_posts(B);
        world.a_posts(B);
        world.a_posts(C);
    });
}

#[test]
fn a_message_is_sent() {
    interrupt_everywhere(&[B, C], nothing, |world| world.a_sends(B));
}

#[test]
fn a_message_waits_for_a_slot() {
    let fill = |world: &World| (0..SLOTS).for_each(|_| world.a_sends(B));
    interrupt_everywhere(&[B, C], fill, |world| world.a_sends(B));
}

#[test]
fn a_peer_is_called() {
    interrupt_everywhere(&[B, C], nothing, |world| world.a_calls(B));
}

#[test]
fn the_processor_calls_itself() {
    interrupt_everywhere(&[B, C], nothing, |world| world.a_calls(A));
}

#[test]
fn tickets_are_polled_and_dropped() {
    interrupt_everywhere(&[B, C], nothing, |world| world.a_polls(B));
}

#[test]
fn requests_are_waited_for_and_served() {
    interrupt_everywhere(&[B, C], nothing, |world| {
        world.a.serve(SECOND).unwrap();
    });
}

#[test]
fn requests_are_served() {
    interrupt_everywhere(&[B, C], nothing, |world| {
        world.a.serve(Duration::ZERO).unwrap();
    });
}

#[test]
fn a_peer_that_restarted_is_noticed() {
    interrupt_everywhere(&[C], World::restart_b, |world| {
        world.a_posts(B);
        world.a_calls(B);
    });
}
