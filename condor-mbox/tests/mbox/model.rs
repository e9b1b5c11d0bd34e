//! Random schedules of three processors, their incarnations and the faults of their doorbells, against
//! what must have happened, in virtual time.
//!
//! This sees only what programs see: outcomes, handlers and counts. `hostile` watches every word
//! instead, but in a system whose doorbells work and where nobody stalls or is known to be dead.

use condor_mbox::Vector;
use proptest::prelude::*;

use world::World;

mod checks;
mod world;

const N: usize = 3;
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
