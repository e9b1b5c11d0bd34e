//! Programs that are killed before every access that they make, and those that go on without them.

use loom::thread;

use crate::world::{Player, SUPERVISOR, World, explore, explore_kills, mortal};

/// Nobody is left with a turn that a dead processor had, gave or was given.
#[test]
fn a_processor_is_killed() {
    explore_kills("killed", 1, |access| {
        let world = World::<2>::entered(&[0, 1]);
        let victim = Player::new(&world, 0);
        let dying = thread::spawn(move || {
            mortal(access, || {
                victim.begin();
                victim.until(10);
                victim.ring(1);
                victim.until(20);
                victim.leave();
            })
        });
        let survivor = Player::new(&world, 1);
        let surviving = thread::spawn(move || {
            survivor.begin();
            survivor.until(10);
            survivor.until(20);
            survivor.until(30);
            survivor.leave();
        });
        let is_dead = dying.join().unwrap();
        world.bury(0, SUPERVISOR, &Player::new(&world, SUPERVISOR));
        world.time_out();
        surviving.join().unwrap();
        is_dead
    });
}

/// It enters again, at the present instant or later, and nothing that was meant for its former incarnation
/// lets it begin before.
#[test]
fn a_processor_is_killed_and_restarted() {
    explore_kills("restarted", 1, |access| {
        let world = World::<2>::new(&[0, 1]);
        let survivor = Player::new(&world, 0);
        let surviving = thread::spawn(move || {
            survivor.enter(0);
            survivor.until(10);
            survivor.until(20);
            survivor.leave();
        });
        let victim = Player::new(&world, 1);
        let dying = thread::spawn(move || {
            mortal(access, || {
                victim.enter(0);
                victim.until(10);
                victim.until(20);
                victim.leave();
            })
        });
        let is_dead = dying.join().unwrap();
        world.bury(1, SUPERVISOR, &Player::new(&world, SUPERVISOR));
        world.time_out();
        let restarted = Player::new(&world, 1);
        restarted.enter(15);
        restarted.until(30);
        restarted.leave();
        surviving.join().unwrap();
        is_dead
    });
}

/// The giver of a turn is late to see that the receiver has gone: it must not take the turn of a new
/// incarnation, which has its own from somebody else.
#[test]
fn a_giver_sees_two_incarnations() {
    explore("two incarnations", 3, || {
        let world = World::<2>::entered(&[0, 1]);
        let giver = Player::new(&world, 0);
        let giving = thread::spawn(move || {
            giver.begin();
            giver.until(10);
            giver.leave();
        });
        let former = Player::new(&world, 1);
        former.begin();
        world.hold(1);
        world.bury(1, SUPERVISOR, &Player::new(&world, SUPERVISOR));
        let restarted = Player::new(&world, 1);
        restarted.enter(0);
        restarted.until(5);
        restarted.until(20);
        restarted.leave();
        giving.join().unwrap();
        assert_eq!(
            world.turns(),
            [(0, 0), (0, 1), (0, 1), (5, 1), (10, 0), (20, 1)]
        );
    });
}

/// The turn goes to one that is dead, by a giver that dies after that.
#[test]
fn the_giver_of_a_dead_one_is_killed() {
    explore_kills("giver", 1, |access| {
        let world = World::<3>::entered(&[0, 1, 2]);
        let victim = Player::new(&world, 0);
        let dying = thread::spawn(move || {
            mortal(access, || {
                victim.begin();
                victim.leave();
            })
        });
        let survivor = Player::new(&world, 2);
        let surviving = thread::spawn(move || {
            survivor.begin();
            survivor.until(10);
            survivor.leave();
        });
        let supervisor = Player::new(&world, SUPERVISOR);
        // It never had a turn, and has none now.
        world.bury(1, SUPERVISOR, &supervisor);
        let is_dead = dying.join().unwrap();
        world.bury(0, SUPERVISOR, &supervisor);
        world.time_out();
        surviving.join().unwrap();
        is_dead
    });
}

/// Time waits for the next incarnation of the service, which rings at the instant at which its former incarnation
/// was told to.
#[test]
fn a_service_is_killed_and_restarted() {
    explore_kills("service", 1, |access| {
        let world = World::<2>::entered(&[0]);
        let victim = Player::new(&world, 1);
        victim.begin_service();
        let dying = thread::spawn(move || {
            let is_dead = mortal(access, || victim.serve(|| victim.world.ring(1, 0, &victim)));
            if is_dead {
                // The supervisor has time stand until the next incarnation has looked.
                victim.world.request(1, 0, &victim);
                victim.world.time_out();
                victim.world.serve(1);
                victim.serve(|| victim.world.ring(1, 0, &victim));
            }
            is_dead
        });
        let own = Player::new(&world, 0);
        own.begin();
        own.tell(1);
        assert_eq!(own.until_rung(0, 20), 0);
        own.until(20);
        own.dismiss(1);
        own.leave();
        dying.join().unwrap()
    });
}

/// A guest dies before, while or after it has the turn that it has requested.
#[test]
fn a_guest_is_killed() {
    explore_kills("guest", 1, |access| {
        let world = World::<2>::entered(&[0]);
        world.visit(1);
        let victim = Player::new(&world, 1);
        let dying = thread::spawn(move || {
            mortal(access, || {
                victim.request(5);
                victim.ring(0);
                victim.finish();
                victim.world.give_up(1, &victim);
            })
        });
        let own = Player::new(&world, 0);
        let surviving = thread::spawn(move || {
            own.begin();
            own.until(5);
            own.until(20);
            own.leave();
        });
        let is_dead = dying.join().unwrap();
        world.bury(1, SUPERVISOR, &Player::new(&world, SUPERVISOR));
        world.time_out();
        surviving.join().unwrap();
        is_dead
    });
}
