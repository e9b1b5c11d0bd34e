//! Parts of the host: services, which time waits for, and guests, which request the turn.

use condor_clock::NEVER;
use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;

use crate::world::{Player, World, explore};

/// A service rings a processor, and only then has it done all. The time of that ring is the time of the
/// message to the service, whatever the others wait for.
#[test]
fn time_waits_for_a_service() {
    explore("service", 2, || {
        let world = World::<3>::entered(&[0, 1]);
        let service = Player::new(&world, 2);
        service.begin_service();
        let serving = thread::spawn(move || {
            service.serve(|| service.world.ring(2, 1, &service));
        });
        let other = Player::new(&world, 1);
        let rung = thread::spawn(move || {
            other.begin();
            assert_eq!(other.until_rung(0, 100), 10);
            other.leave();
        });
        let own = Player::new(&world, 0);
        own.begin();
        own.until(10);
        own.tell(2);
        own.until(20);
        own.dismiss(2);
        own.leave();
        rung.join().unwrap();
        serving.join().unwrap();
        let turns = [(0, 0), (0, 1), (10, 0), (10, 1), (20, 0)];
        assert_eq!(world.turns(), turns);
    });
}

/// A service rings another one, and has then done all itself: there is a service that has something to
/// do at every moment, though not the same one.
#[test]
fn time_waits_for_a_chain_of_services() {
    explore("chain of services", 1, || {
        let world = World::<3>::entered(&[0]);
        let last = Player::new(&world, 1);
        last.begin_service();
        let ringing = thread::spawn(move || {
            last.serve(|| last.world.ring(1, 0, &last));
        });
        let first = Player::new(&world, 2);
        first.begin_service();
        let telling = thread::spawn(move || {
            first.serve(|| first.tell(1));
            first.dismiss(1);
        });
        let own = Player::new(&world, 0);
        own.begin();
        own.tell(2);
        assert_eq!(own.until_rung(0, 20), 0);
        own.dismiss(2);
        own.leave();
        telling.join().unwrap();
        ringing.join().unwrap();
    });
}

/// A guest has the turn at its instant, after the processors of that instant; it rings one.
#[test]
fn a_guest_has_its_turn_at_its_instant() {
    explore("guest", 2, || {
        let world = World::<3>::new(&[1, 2]);
        world.visit(0);
        let guest = Player::new(&world, 0);
        world.request(0, 10, &guest);
        let visiting = thread::spawn(move || {
            while !guest.world.await_request(0, 0, &guest) {}
            assert_eq!(guest.note(), 10);
            guest.ring(2);
            guest.finish();
        });
        world.announce(1, 0);
        world.announce(2, 0);
        let own = Player::new(&world, 1);
        world.kick(1, &own);
        let other = Player::new(&world, 2);
        let rung = thread::spawn(move || {
            other.begin();
            assert_eq!(other.until_rung(0, 100), 10);
            other.leave();
        });
        own.begin();
        own.until(10);
        own.until(20);
        own.leave();
        rung.join().unwrap();
        visiting.join().unwrap();
        let turns = [(0, 1), (0, 2), (10, 1), (10, 0), (10, 2), (20, 1)];
        assert_eq!(world.turns(), turns);
    });
}

/// A guest asks at any moment, waits and finishes, or goes away before or after it was given the turn.
#[test]
fn a_guest_comes_and_goes() {
    for waits in [true, false] {
        explore("guest that comes and goes", 2, move || {
            let world = World::<2>::entered(&[0]);
            let guest = Player::new(&world, 1);
            let visiting = thread::spawn(move || {
                guest.world.visit(1);
                if waits {
                    guest.request(0);
                    guest.finish();
                } else {
                    guest.world.request(1, 0, &guest);
                }
                guest.world.give_up(1, &guest);
            });
            let own = Player::new(&world, 0);
            own.begin();
            own.until(10);
            own.until(20);
            own.leave();
            visiting.join().unwrap();
        });
    }
}

/// The last processor waits for ever: whoever makes that otherwise, sees that nobody has the turn, or is
/// seen by the one that sets it free.
#[test]
fn a_kick_is_not_lost() {
    explore("kick", 3, || {
        let world = World::<2>::entered(&[0]);
        let guest = Player::new(&world, 1);
        let typing = thread::spawn(move || guest.world.ring(1, 0, &guest));
        let own = Player::new(&world, 0);
        own.begin();
        assert_eq!(own.until_rung(0, NEVER), 0);
        own.leave();
        typing.join().unwrap();
    });
}

/// A processor asks a service and keeps the turn: what the service wrote before it rang is seen.
#[test]
fn an_answer_is_seen_with_its_ring() {
    explore("answer", 2, || {
        let world = World::<2>::entered(&[0]);
        let answer = Arc::new(UnsafeCell::new(0));
        let service = Player::new(&world, 1);
        service.begin_service();
        let theirs = answer.clone();
        let serving = thread::spawn(move || {
            service.serve(|| {
                // SAFETY: loom checks that nobody else uses it.
                theirs.with_mut(|answer| unsafe { *answer = 7 });
                service.world.ring(1, 0, &service);
            });
        });
        let own = Player::new(&world, 0);
        own.begin();
        own.tell(1);
        while own.rings() == 0 {
            own.world.ask(0, 1, 0, &own);
        }
        // SAFETY: as above.
        assert_eq!(answer.with(|answer| unsafe { *answer }), 7);
        own.dismiss(1);
        own.until(1);
        own.leave();
        serving.join().unwrap();
    });
}
