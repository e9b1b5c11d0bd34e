//! Processors that hand the turn over to each other.

use std::ops::Deref;

use condor_clock::{LOOPS, LocalClock, NEVER, Page};
use loom::sync::Arc;
use loom::thread;

use crate::world::{Player, World, explore};

/// Two enter at the same time, and one waits for the other to enter; they go on at different instants
/// and at the same one.
#[test]
fn two_enter_and_take_turns() {
    explore("two enter", 2, || {
        let world = World::<2>::new(&[0, 1]);
        let other = Player::new(&world, 1);
        let thread = thread::spawn(move || {
            other.enter(0);
            other.until(20);
            other.until(30);
            other.leave();
        });
        let own = Player::new(&world, 0);
        own.enter(0);
        own.until(10);
        own.until(30);
        own.leave();
        thread.join().unwrap();
        let turns = [(0, 0), (0, 1), (10, 0), (20, 1), (30, 0), (30, 1)];
        assert_eq!(world.turns(), turns);
    });
}

#[test]
fn three_take_turns() {
    explore("three", 2, || {
        let world = World::<3>::entered(&[0, 1, 2]);
        let threads = [1, 2].map(|number| {
            let player = Player::new(&world, number);
            thread::spawn(move || {
                player.begin();
                player.until(10);
                player.leave();
            })
        });
        let own = Player::new(&world, 0);
        own.begin();
        own.until(5);
        own.leave();
        for thread in threads {
            thread.join().unwrap();
        }
        let turns = [(0, 0), (0, 1), (0, 2), (5, 0), (10, 1), (10, 2)];
        assert_eq!(world.turns(), turns);
    });
}

/// A ring ends a wait at its instant; one that came before the wait does so, too; and the end of a
/// program rings.
#[test]
fn rings_end_waits_at_their_instants() {
    explore("rings", 2, || {
        let world = World::<2>::entered(&[0, 1]);
        let other = Player::new(&world, 1);
        let thread = thread::spawn(move || {
            other.begin();
            // Rung at instant 0, before it has looked.
            assert_eq!(other.until_rung(0, 100), 0);
            assert_eq!(other.until_rung(1, 100), 10);
            assert_eq!(other.until_rung(2, 15), 15);
            assert_eq!(other.until_rung(2, 100), 20);
            other.leave();
        });
        let own = Player::new(&world, 0);
        own.begin();
        own.ring(1);
        own.until(10);
        own.ring(1);
        own.until(20);
        own.leave();
        thread.join().unwrap();
        let turns = [
            (0, 0),
            (0, 1),
            (0, 1),
            (10, 0),
            (10, 1),
            (15, 1),
            (20, 0),
            (20, 1),
        ];
        assert_eq!(world.turns(), turns);
    });
}

/// One is held for while it is started: it begins at the instant of the hold.
#[test]
fn time_stands_for_one_that_enters_late() {
    explore("late", 2, || {
        let world = World::<2>::entered(&[0]);
        let own = Player::new(&world, 0);
        own.begin();
        own.until(10);
        world.hold(1);
        let other = Player::new(&world, 1);
        let thread = thread::spawn(move || {
            other.enter(0);
            other.until(15);
            other.leave();
        });
        own.until(20);
        own.leave();
        thread.join().unwrap();
        let turns = [(0, 0), (10, 0), (10, 1), (15, 1), (20, 0)];
        assert_eq!(world.turns(), turns);
    });
}

struct OnPage(Arc<World<2>>);

impl Deref for OnPage {
    type Target = Page<2>;

    fn deref(&self) -> &Page<2> {
        &self.0
    }
}

/// Another thread of a program rings while the program waits: it takes the turn for a moment, by which
/// the program must not go on.
#[test]
fn another_thread_of_a_program_rings() {
    explore("other thread", 2, || {
        let world = World::<2>::entered(&[0, 1]);
        // Without the turn, so that there is one to take.
        world.hold(1);
        let own = Player::new(&world, 0);
        let thread = thread::spawn(move || {
            own.begin();
            own.until(10);
            own.leave();
        });
        let helper = Player::new(&world, 0);
        world.ring(0, 1, &helper);
        world.release(1);
        world.kick(0, &helper);
        let clock = LocalClock::new(1, OnPage(world.clone()), Player::new(&world, 1), [0; LOOPS]);
        clock.page().first_turn(1, clock.handover());
        assert_eq!((clock.now(), clock.rings()), (0, 1));
        clock.wait(1, NEVER, None);
        // The end of the other program.
        assert_eq!(clock.now(), 10);
        clock.leave();
        thread.join().unwrap();
        assert_eq!(world.turns(), [(0, 0), (10, 0)]);
    });
}
