use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};

use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::sync::{AtomicU32, Ordering};

/// All programs in one thread: each dies where it would sleep.
#[derive(Default)]
struct Mortal {
    wall_ns: Cell<u64>,
    /// Who was woken, and by which word.
    woken: RefCell<Vec<(u8, *const AtomicU32)>>,
}

impl Handover for Mortal {
    fn sleep(&self, _: &AtomicU32, _: u32, _: u64) {
        std::panic::resume_unwind(Box::new(Sleeps));
    }

    fn wake(&self, number: u8, word: &AtomicU32) {
        self.woken.borrow_mut().push((number, word));
    }

    fn wall_ns(&self) -> Option<u64> {
        Some(self.wall_ns.get())
    }
}

#[derive(Debug)]
struct Sleeps;

/// Makes a page in which `processors` have entered.
fn entered(processors: &[u8], by: &Mortal) -> Page<4> {
    let page = Page::new();
    for &number in processors {
        page.announce(number, 0);
    }
    page.kick(0, by);
    page
}

/// `me` waits, and dies when it sleeps.
fn dies(page: &Page<4>, me: u8, at: u64, until: Until, by: &Mortal) {
    let slept = catch_unwind(AssertUnwindSafe(|| page.turn(me, at, until, by)));
    assert!(slept.unwrap_err().is::<Sleeps>());
}

const RUNG: Until = Until::Ring { seen: 0 };

#[repr(align(64))]
struct Words([AtomicU32; size_of::<Page>() / 4 + 16]);

impl Words {
    fn of(words: &[u32]) -> Self {
        let word = |index| words.get(index).copied().unwrap_or(0);
        Self(std::array::from_fn(|index| AtomicU32::new(word(index))))
    }
}

#[test]
fn a_page_lies_in_words_that_are_aligned_and_enough() {
    let words = Words::of(&[7, 8]);
    assert!(Page::<32>::from_words(&words.0[1..]).is_none());
    assert!(Page::<32>::from_words(&words.0[..words.0.len() - 17]).is_none());
    let page = Page::<32>::from_words(&words.0).unwrap();
    let error = page.check().unwrap_err();
    assert_eq!((error.magic, error.version), (7, 8));
    page.reset(0);
    assert_eq!(page.check(), Ok(()));
    assert_eq!(words.0[0].load(Ordering::Relaxed).to_le_bytes(), *b"CCLK");
}

#[test]
fn it_is_said_what_time_waits_for() {
    let by = Mortal::default();
    let page = Page::<4>::new();
    assert_eq!(page.standing(&by), Obstacle::Idle);
    page.hold(2);
    assert_eq!(page.standing(&by), Obstacle::Entry { of: 2 });
    page.announce(2, 10);
    page.serve(3);
    page.finish(3, &by);
    page.count_ring(3);
    assert_eq!(page.standing(&by), Obstacle::Service { number: 3 });
    page.set_limit(5);
    page.consumed(3, 1, &by);
    assert_eq!(page.standing(&by), Obstacle::Limit);
    page.set_limit(NEVER);
    page.kick(0, &by);
    let turn = |asks| Obstacle::Turn { holder: 2, asks };
    assert_eq!(page.standing(&by), turn(None));
    // It asks the service, which has an answer at last.
    page.first_turn(2, &by);
    page.count_ring(3);
    let slept = catch_unwind(AssertUnwindSafe(|| page.ask(2, 3, 0, &by)));
    assert!(slept.is_err());
    assert_eq!(page.standing(&by), turn(Some(3)));
    assert!(!page.is_busy(2));
    page.consumed(3, 2, &by);
    assert_eq!(page.standing(&by), turn(None));
}

#[test]
fn a_stop_ends_waits_for_rings_only() {
    let by = Mortal::default();
    let page = entered(&[0], &by);
    page.first_turn(0, &by);
    page.set_stop_at(10);
    assert_eq!(page.turn(0, 5, RUNG, &by), 5);
    assert_eq!(page.turn(0, 100, RUNG, &by), 10);
    // It knows of the stop already.
    assert_eq!(page.turn(0, 100, RUNG, &by), 100);
    page.set_stop_at(110);
    assert_eq!(page.turn(0, 120, Until::Instant, &by), 120);
}

#[test]
fn time_keeps_pace_and_catches_up_a_little() {
    let by = Mortal::default();
    let page = Page::<4>::new();
    page.set_speed(500, &by);
    page.announce(0, 100);
    page.kick(0, &by);
    assert_eq!(page.standing(&by), Obstacle::Pace);
    by.wall_ns.set(199);
    page.kick(0, &by);
    assert_eq!(page.holder(), None);
    // A little too late, and in time again.
    by.wall_ns.set(300);
    page.kick(0, &by);
    assert!(page.has_turn(0));
    page.first_turn(0, &by);
    dies(&page, 0, 200, Until::Instant, &by);
    by.wall_ns.set(400);
    page.kick(0, &by);
    assert_eq!((page.has_turn(0), page.now()), (true, 200));
    // Much too late: it does not run after the real time.
    dies(&page, 0, 300, Until::Instant, &by);
    by.wall_ns.set(1_000_000_000);
    page.kick(0, &by);
    assert_eq!(page.now(), 300);
    dies(&page, 0, 400, Until::Instant, &by);
    by.wall_ns.set(1_000_000_199);
    page.kick(0, &by);
    assert_eq!(page.holder(), None);
}

#[test]
fn peers_of_one_that_ends_are_rung_before_others_go_on() {
    let by = Mortal::default();
    for leaves in [true, false] {
        let page = entered(&[0, 1], &by);
        page.first_turn(0, &by);
        dies(&page, 0, 50, RUNG, &by);
        assert!(page.has_turn(1));
        page.first_turn(1, &by);
        by.woken.take();
        if leaves {
            page.leave(1, &by);
        } else {
            page.bury(1, 0xf0, &by);
        }
        assert!(!page.is_alive(1) && page.has_turn(0));
        // Time has not passed: it would have gone on at 50.
        assert_eq!((page.now(), page.rings(0), page.rings(1)), (0, 1, 0));
        let line = &page.lines[0];
        let (rings, grants) = (&raw const line.rings, &raw const line.grants);
        assert_eq!(by.woken.take(), [(0, rings), (0, grants)]);
    }
}

/// It was killed while it waited for a ring.
#[test]
fn a_number_begins_anew() {
    let by = Mortal::default();
    let page = entered(&[0, 1], &by);
    page.first_turn(0, &by);
    dies(&page, 0, NEVER, RUNG, &by);
    page.first_turn(1, &by);
    page.bury(0, 0xf0, &by);
    page.count_ring(0);
    page.visit(0);
    assert_eq!(page.turn(1, 10, Until::Instant, &by), 10);
    page.give_up(0, &by);
    page.announce(0, 30);
    assert_eq!(page.turn(1, 20, Until::Instant, &by), 20);
    page.leave(1, &by);
    page.first_turn(0, &by);
    assert_eq!(page.now(), 30);
}

#[test]
fn a_deferred_entry_is_seen_by_others() {
    let by = Mortal::default();
    let page = entered(&[0, 1], &by);
    page.first_turn(0, &by);
    dies(&page, 0, NEVER, RUNG, &by);
    page.first_turn(1, &by);
    page.hold(0);
    page.bury(0, 0xf0, &by);
    page.defer(0, 30);
    page.announce(0, 0);
    assert_eq!(page.turn(1, 20, Until::Instant, &by), 20);
    page.leave(1, &by);
    page.first_turn(0, &by);
    assert_eq!(page.now(), 30);
}

#[test]
fn one_that_has_gone_requests_nothing() {
    let by = Mortal::default();
    let page = entered(&[0], &by);
    page.first_turn(0, &by);
    for free in [Page::free, |page: &Page<4>, number, _, by: &Mortal| {
        page.give_up(number, by);
    }] {
        page.serve(1);
        free(&page, 1, 0xf0, &by);
        let at = page.now() + 10;
        assert_eq!(page.turn(0, at, Until::Instant, &by), at);
    }
}

/// A service that dies between its request and the end of it has the turn in its next incarnation, so that
/// no time passes between the two; so has one that died while it gave the turn on.
#[test]
fn the_next_incarnation_of_a_service_has_its_turn() {
    let by = Mortal::default();
    let page = Page::<4>::new();
    page.serve(1);
    page.announce(0, 10);
    page.kick(0, &by);
    assert!(page.has_turn(1));
    page.serve(1);
    assert!(page.has_turn(1));
    let turn = page.turn.load(Ordering::Relaxed);
    page.pass(turn, Some(1 | PASSING)).unwrap();
    assert_eq!(page.holder(), Some(1));
    assert!(!page.has_turn(1));
    page.serve(1);
    assert!(page.has_turn(1));
    page.finish(1, &by);
    assert_eq!((page.has_turn(0), page.now()), (true, 10));
}

/// The turn is free, and so taken before time passes; those that are due before are served first.
#[test]
fn who_awaits_its_request_takes_a_free_turn_at_its_instant() {
    let by = Mortal::default();
    let page = Page::<4>::new();
    page.hold(0);
    page.visit(1);
    page.request(1, 5, &by);
    let waits = || page.await_request(1, 0, &by);
    assert!(catch_unwind(AssertUnwindSafe(waits)).is_err());
    page.request(1, 0, &by);
    assert!(waits());
    page.finish(1, &by);
    assert_eq!(page.holder(), None);
    // Without a line it has no instant.
    assert!(page.await_request(0xf0, 0, &by));
    page.announce(0, 0);
    page.request(1, 0, &by);
    page.finish(0xf0, &by);
    assert!(page.has_turn(0));
}

fn words() -> impl Strategy<Value = u32> {
    prop_oneof![
        0..6_u32,
        Just(u32::MAX),
        any::<u32>(),
        (any::<u16>(), 0..40_u32).prop_map(|(count, holder)| u32::from(count) << 8 | holder),
    ]
}

proptest! {
    /// Who writes anything there has nobody panic, and nobody that does not wait for ever.
    #[test]
    fn any_words_are_a_page(words in vec(words(), size_of::<Page<4>>() / 4), me: u8, number: u8) {
        let words = Words::of(&words);
        let page = Page::<4>::from_words(&words.0).unwrap();
        let by = Mortal::default();
        by.wall_ns.set(1 << 60);
        let calls: [&dyn Fn(); 14] = [
            &|| page.kick(me, &by),
            &|| page.ring(me, number, &by),
            &|| page.announce(number, 5),
            &|| page.first_turn(number, &by),
            &|| { page.turn(me, 7, RUNG, &by); },
            &|| page.ask(me, number, 3, &by),
            &|| page.serve(number),
            &|| page.consumed(number, 3, &by),
            &|| page.request(number, 3, &by),
            &|| { page.await_request(number, 3, &by); },
            &|| page.finish(number, &by),
            &|| page.leave(number, &by),
            &|| page.bury(number, me, &by),
            &|| { page.standing(&by).to_string(); },
        ];
        for call in calls {
            if let Err(payload) = catch_unwind(AssertUnwindSafe(call)) {
                prop_assert!(payload.is::<Sleeps>(), "it panics");
            }
        }
    }
}
