//! Messages with and without reply, on the simulated backend in virtual time.

use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use condor_mbox::error::{LayoutField, MemoryObject};
use condor_mbox::sim::{SimDoorbell, SimMailbox, SimSystem, SimWindow};
use condor_mbox::{
    Call, Clock, CriticalSection, Doorbell, Instant, MailboxError, Messenger, PeerState, Processor,
    SendProgress, Vector, Waiting, layout,
};

const A: Processor = Processor(0);
const B: Processor = Processor(1);
const SECOND: Duration = Duration::from_secs(1);
const V: Vector = Vector(12);

/// A processor whose program runs while others wait; it lives as long as the test.
fn attend<const N: usize>(
    system: &SimSystem<N>,
    mailbox: SimMailbox<'static, N>,
) -> &'static SimMailbox<'static, N> {
    let mailbox = &*Box::leak(Box::new(mailbox));
    system.while_waiting(mailbox.number(), || {
        mailbox.serve(Duration::ZERO).unwrap();
    });
    mailbox
}

fn double(call: &Call<'_>) -> u32 {
    call.data().wrapping_mul(2)
}

fn pair_of<const N: usize>() -> (SimSystem<N>, SimMailbox<'static, N>, SimMailbox<'static, N>) {
    let system = SimSystem::<N>::in_virtual_time(4096);
    let mut a = system.mailbox(A).unwrap();
    let mut b = system.mailbox(B).unwrap();
    b.set_vector(V, &double, "doubles").unwrap();
    a.join().unwrap();
    b.join().unwrap();
    (system, a, b)
}

#[test]
fn a_reply_is_what_the_handler_returned() {
    let (system, a, b) = pair_of::<2>();
    let b = attend(&system, b);
    for data in [0, 1, 21, u32::MAX] {
        assert_eq!(
            a.send_with_reply(B, V, data, SECOND),
            Ok(data.wrapping_mul(2))
        );
    }
    assert_eq!(
        b.peer_state(A),
        Ok(PeerState::Up {
            incarnation: 1,
            connected: true
        })
    );
    let statistics = a.vector_statistics(B, V).unwrap();
    assert_eq!((statistics.name(), statistics.handled), ("doubles", 4));
    assert_eq!(a.vector_statistics(A, V).unwrap().sent, 4);
}

#[test]
fn a_processor_can_send_to_itself() {
    let (_system, mut a, _b) = pair_of::<2>();
    a.set_vector(V, &double, "own").unwrap();
    assert_eq!(a.send_with_reply(A, V, 4, SECOND), Ok(8));
}

#[test]
fn messages_are_started_in_order() {
    static SEEN: Mutex<Vec<u32>> = Mutex::new(Vec::new());
    let (system, a, mut b) = pair_of::<3>();
    b.set_vector(
        Vector(1),
        &|call| {
            SEEN.lock().unwrap().push(call.data());
            0
        },
        "log",
    )
    .unwrap();
    attend(&system, b);
    for data in 0..100 {
        a.send(B, Vector(1), data, SECOND).unwrap();
    }
    assert_eq!(a.send_with_reply(B, V, 1, SECOND), Ok(2));
    assert_eq!(*SEEN.lock().unwrap(), (0..100).collect::<Vec<_>>());
}

#[test]
fn calls_nest_both_ways_to_a_bound() {
    static DEEPEST: AtomicU32 = AtomicU32::new(0);
    // Each end asks the other for one less until nothing is left.
    fn count_down(call: &Call<'_>) -> u32 {
        DEEPEST.fetch_max(call.data(), Ordering::Relaxed);
        if call.data() == 0 {
            return 0;
        }
        match call.send_with_reply(call.sender(), Vector(2), call.data() - 1, SECOND) {
            Ok(value) => value + 1,
            Err(MailboxError::TooDeep { depth }) => 1000 + depth,
            Err(error) => panic!("{error}"),
        }
    }
    let (system, mut a, mut b) = pair_of::<2>();
    a.set_vector(Vector(2), &count_down, "count").unwrap();
    b.set_vector(Vector(2), &count_down, "count").unwrap();
    let a = attend(&system, a);
    attend(&system, b);
    for depth in 0..12 {
        assert_eq!(a.send_with_reply(B, Vector(2), depth, SECOND), Ok(depth));
    }
    assert!(a.send_with_reply(B, Vector(2), 100, SECOND).unwrap() > 1000);
    assert_eq!(a.send_with_reply(B, V, 3, SECOND), Ok(6));
}

#[test]
fn every_mail_is_large_enough() {
    let system = SimSystem::<2>::in_virtual_time(0);
    let found = layout::mail_bytes(2) - 4;
    for processor in [A, B] {
        let mut windows = system.windows(A);
        windows[processor.index()].mail = SimWindow::new(found);
        let bell = system.doorbell(A);
        let refused = condor_mbox::Mailbox::<(_, _, _), 2>::new(A, windows, bell, CriticalSection);
        assert_eq!(
            refused.map(drop),
            Err(MailboxError::Layout {
                processor,
                object: MemoryObject::Mail,
                field: LayoutField::MailSize,
                found,
                expected: found + 4,
            })
        );
    }
}

#[test]
fn errors_carry_their_values() {
    let (system, a, b) = pair_of::<2>();
    let to = Processor(7);
    assert_eq!(
        a.send(to, V, 0, SECOND),
        Err(MailboxError::NoSuchProcessor {
            number: to,
            processors: 2
        })
    );
    let (system_of_one, number) = (SimSystem::<1>::in_virtual_time(0).mailbox(A).unwrap(), A);
    let itself = system_of_one.listen(Some(A), SECOND);
    assert_eq!(itself, Err(MailboxError::ListensToItself { number }));
    let vector = Vector(200);
    assert_eq!(
        a.send(B, vector, 0, SECOND),
        Err(MailboxError::NoSuchVector { vector })
    );
    let b = attend(&system, b);
    assert_eq!(
        a.send_with_reply(B, Vector(3), 0, SECOND),
        Err(MailboxError::NoHandler {
            to: B,
            vector: Vector(3)
        })
    );
    assert_eq!(a.send_with_reply(B, V, 1, SECOND), Ok(2));
    system.stall(B, true);
    let vector = V;
    assert_eq!(
        a.send_with_reply(B, V, 1, SECOND),
        Err(MailboxError::Stalled {
            to: B,
            vector,
            progress: SendProgress::MayRun
        })
    );
    system.stall(B, false);
    assert_eq!(a.send_with_reply(B, V, 5, SECOND), Ok(10));
    system.kill(B);
    let _ = b;
    assert_eq!(
        a.send_with_reply(B, V, 1, SECOND),
        Err(MailboxError::PeerDied {
            to: B,
            progress: SendProgress::Never
        })
    );
    let mut again = system.mailbox(B).unwrap();
    again.set_vector(V, &|_| 77, "other").unwrap();
    again.join().unwrap();
    attend(&system, again);
    assert_eq!(a.send_with_reply(B, V, 1, SECOND), Ok(77));
}

#[test]
fn tickets_are_polled_and_late_replies_dropped() {
    let (_system, a, b) = pair_of::<2>();
    b.serve(Duration::ZERO).unwrap();
    let mut ticket = a.begin(B, V, 4, Duration::ZERO).unwrap();
    assert_eq!(ticket.poll(), Ok(None));
    assert_eq!(b.serve(Duration::ZERO), Ok(1));
    assert_eq!(ticket.poll(), Ok(Some(8)));
    // Abandoned calls keep their slots until the reply comes.
    for _ in 0..8 {
        drop(a.begin(B, V, 1, Duration::ZERO).unwrap());
    }
    assert_eq!(
        a.begin(B, V, 1, Duration::ZERO).map(drop),
        Err(MailboxError::NoSlot { to: B })
    );
    assert_eq!(b.serve(Duration::ZERO), Ok(8));
    for _ in 0..8 {
        drop(a.begin(B, V, 1, Duration::ZERO).unwrap());
    }
}

#[test]
fn a_listener_gets_each_message_and_the_holder_replies() {
    static HEARD: Mutex<Vec<(Processor, Processor, u32)>> = Mutex::new(Vec::new());
    let (system, a, b) = pair_of::<3>();
    let mut c = system.mailbox(Processor(2)).unwrap();
    let hear = |call: &Call<'_>| {
        HEARD
            .lock()
            .unwrap()
            .push((call.sender(), call.addressee(), call.data()));
        999
    };
    c.set_listener(Box::leak(Box::new(hear)));
    c.join().unwrap();
    attend(&system, b);
    c.listen(Some(B), SECOND).unwrap();
    let c = attend(&system, c);
    for data in 0..50 {
        assert_eq!(a.send_with_reply(B, V, data, SECOND), Ok(data * 2));
    }
    c.serve(Duration::ZERO).unwrap();
    assert_eq!(
        *HEARD.lock().unwrap(),
        (0..50).map(|data| (A, B, data)).collect::<Vec<_>>()
    );
    assert_eq!(c.missed(A), Ok(0));
}

/// As a command does that sends a message and ends.
#[test]
fn a_sender_that_has_left_is_heard_once() {
    static HEARD: Mutex<Vec<(u32, u32)>> = Mutex::new(Vec::new());
    fn note(call: &Call<'_>) -> u32 {
        let mut heard = HEARD.lock().unwrap();
        heard.push((call.sender_incarnation(), call.data()));
        0
    }
    let (system, mut a, b) = pair_of::<3>();
    attend(&system, b);
    let mut c = system.mailbox(Processor(2)).unwrap();
    c.set_listener(&note);
    c.join().unwrap();
    // Before anybody listened.
    assert_eq!(a.send_with_reply(B, V, 1, SECOND), Ok(2));
    a.leave().unwrap();
    c.listen(Some(B), SECOND).unwrap();
    for data in [2, 3] {
        a.join().unwrap();
        assert_eq!(a.send_with_reply(B, V, data, SECOND), Ok(2 * data));
        a.leave().unwrap();
        for _ in 0..2 {
            c.serve(Duration::ZERO).unwrap();
        }
    }
    assert_eq!(*HEARD.lock().unwrap(), [(0, 2), (0, 3)]);
    assert_eq!(c.missed(A), Ok(0));
}

#[test]
fn a_message_says_in_which_incarnation_it_was_sent() {
    static SEEN: Mutex<Vec<(Processor, u32)>> = Mutex::new(Vec::new());
    fn note(call: &Call<'_>) -> u32 {
        let mut seen = SEEN.lock().unwrap();
        seen.push((call.addressee(), call.sender_incarnation()));
        0
    }
    let (system, a, mut b) = pair_of::<3>();
    let mut c = system.mailbox(Processor(2)).unwrap();
    b.set_vector(Vector(1), &note, "notes").unwrap();
    c.set_listener(&note);
    c.join().unwrap();
    let b = attend(&system, b);
    c.listen(Some(B), SECOND).unwrap();
    let mut lives = Vec::new();
    let mut former = Some(a);
    for _ in 0..2 {
        let a = former.take().unwrap_or_else(|| {
            let mut next = system.mailbox(A).unwrap();
            next.join().unwrap();
            next
        });
        a.send_with_reply(B, Vector(1), 0, SECOND).unwrap();
        c.serve(Duration::ZERO).unwrap();
        let Ok(PeerState::Up { incarnation, .. }) = b.peer_state(A) else {
            panic!("{:?}", b.peer_state(A));
        };
        lives.push(incarnation);
        system.kill(A);
        drop(a);
    }
    assert_ne!(lives[0], lives[1]);
    let seen = lives.iter().flat_map(|&incarnation| [(B, incarnation); 2]);
    assert_eq!(*SEEN.lock().unwrap(), seen.collect::<Vec<_>>());
}

/// A million random runs behind caches found a listener that never looked at its clock.
#[test]
fn a_listener_that_always_hears_something_ends_its_wait() {
    static HEARD: AtomicU32 = AtomicU32::new(0);
    const MOST: u32 = 20_000;
    let (system, a, b) = pair_of::<4>();
    let (a, b) = (&*Box::leak(Box::new(a)), attend(&system, b));
    let mut c = system.mailbox(Processor(2)).unwrap();
    // Each message that is heard makes the next one.
    let hear = |_: &Call<'_>| {
        if HEARD.fetch_add(1, Ordering::Relaxed) < MOST {
            b.serve(Duration::ZERO).unwrap();
            a.send(B, V, 0, Duration::ZERO).unwrap();
        }
        0
    };
    c.set_listener(Box::leak(Box::new(hear)));
    c.join().unwrap();
    c.listen(Some(B), SECOND).unwrap();
    a.send(B, V, 0, Duration::ZERO).unwrap();
    let nobody = Processor(3);
    assert_eq!(
        c.wait_for_peer(nobody, None, Duration::from_micros(10)),
        Err(MailboxError::NotConnected { to: nobody })
    );
    assert!((10..1000).contains(&HEARD.load(Ordering::Relaxed)));
}

#[test]
fn what_was_sent_before_leaving_arrives() {
    static SEEN: AtomicU32 = AtomicU32::new(0);
    fn note(call: &Call<'_>) -> u32 {
        SEEN.fetch_add(call.data(), Ordering::Relaxed)
    }
    let (_system, mut a, mut b) = pair_of::<2>();
    b.set_vector(Vector(1), &note, "note").unwrap();
    b.serve(Duration::ZERO).unwrap();
    a.send(B, Vector(1), 1, SECOND).unwrap();
    a.send(B, Vector(1), 20, SECOND).unwrap();
    a.leave().unwrap();
    // The sender is gone, and the receiver has noticed by trying to send to it.
    assert_eq!(
        b.send(A, V, 0, Duration::ZERO),
        Err(MailboxError::NotConnected { to: A })
    );
    assert_eq!(b.serve(Duration::ZERO), Ok(2));
    assert_eq!(SEEN.load(Ordering::Relaxed), 21);
}

/// A doorbell at one of whose readings of the clock something happens.
struct AtReading<F> {
    bell: SimDoorbell,
    left: Cell<u32>,
    happens: F,
}

impl<F: Fn()> Clock for AtReading<F> {
    fn now(&self) -> Instant {
        if self.left.replace(self.left.get().saturating_sub(1)) == 1 {
            (self.happens)();
        }
        self.bell.now()
    }
}

impl<F: Fn()> Doorbell for AtReading<F> {
    type Seen = u64;

    fn ring(&self, processor: Processor) {
        self.bell.ring(processor);
    }

    fn prepare(&self) -> u64 {
        self.bell.prepare()
    }

    fn wait(&self, seen: u64, until: Instant, whom: Option<Processor>) {
        self.bell.wait(seen, until, whom);
    }
}

#[test]
fn a_sleeper_serves_everything_before_it_sleeps() {
    // Before the first look of a wait, and between that and the look before the sleep.
    for reading in [1, 2] {
        let served = AtomicU32::new(0);
        let count = |_: &Call<'_>| served.fetch_add(1, Ordering::Relaxed);
        let system = SimSystem::<3>::in_virtual_time(4096);
        let mut b = system.mailbox(B).unwrap();
        let mut c = system.mailbox(Processor(2)).unwrap();
        b.join().unwrap();
        c.join().unwrap();
        let bell = AtReading {
            bell: system.doorbell(A),
            left: Cell::new(0),
            // Nobody is rung for these: A does not sleep yet.
            happens: || (0..5).for_each(|_| c.send(A, V, 0, Duration::ZERO).unwrap()),
        };
        let mut a =
            condor_mbox::Mailbox::<(_, _, _), 3>::new(A, system.windows(A), bell, CriticalSection)
                .unwrap();
        a.set_waiting(Waiting::Sleep);
        a.set_vector(V, &count, "count").unwrap();
        a.join().unwrap();
        for mailbox in [&b, &c] {
            mailbox.serve(Duration::ZERO).unwrap();
        }
        a.serve(Duration::ZERO).unwrap();
        a.doorbell().left.set(reading);
        // This wait is shorter than the naps of a sleeper.
        let short = Duration::from_micros(100);
        assert!(a.send_with_reply(B, V, 0, short).is_err());
        assert_eq!(served.load(Ordering::Relaxed), 5, "reading {reading}");
    }
}
