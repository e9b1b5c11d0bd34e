//! What is interrupted: programs, each with all sets of up to four loops.

use interrupt_injector::{Interrupts, explore};

use super::oracle::Asked;
use super::world::{END, Kind, Set, Simulated, World};
use crate::lock::LoopLock;
use crate::loops::Loops as _;
use crate::process::{LoopId, Overrun};
use crate::rate::{Rate, greatest_common_divisor};
use crate::sim::{SimPlatform, Vectored};

/// How deep interrupts come within interrupts.
const INTERRUPTS: Interrupts = Interrupts::Nested(3);

/// A program that is run with one set, and says how many runs it made.
trait Program {
    fn explore<P: Simulated, const L: usize>(&self, set: &Set<L>, kind: Kind) -> u64;
}

/// Explores a program with all sets of rates of 1 to `fastest` Hz that are not multiples of others,
/// the slowest loop first: numbers and ranks differ.
fn with_all_sets(name: &str, program: &impl Program, kinds: &[Kind], overrun: Overrun) {
    with_all_sets_on::<SimPlatform>(name, program, kinds, overrun);
    with_all_sets_on::<Vectored>(name, program, kinds, overrun);
}

fn with_all_sets_on<P: Simulated>(
    name: &str,
    program: &impl Program,
    kinds: &[Kind],
    overrun: Overrun,
) {
    // In Miri, the way through is what is checked.
    let (fastest, loops) = if cfg!(miri) { (1, 1) } else { (FASTEST, 4) };
    let begun = std::time::Instant::now();
    let mut runs = 0;
    let mut sets = 0;
    for &kind in kinds {
        for rates in sets_of::<1>(fastest) {
            sets += 1;
            runs += program.explore::<P, 1>(&Set::new(rates, overrun), kind);
        }
        for rates in sets_of::<2>(fastest).filter(|_| loops >= 2) {
            sets += 1;
            runs += program.explore::<P, 2>(&Set::new(rates, overrun), kind);
        }
        for rates in sets_of::<3>(fastest).filter(|_| loops >= 3) {
            sets += 1;
            runs += program.explore::<P, 3>(&Set::new(rates, overrun), kind);
        }
        for rates in sets_of::<4>(fastest).filter(|_| loops >= 4) {
            sets += 1;
            runs += program.explore::<P, 4>(&Set::new(rates, overrun), kind);
        }
    }
    let (seconds, nesting) = (begun.elapsed().as_secs_f32(), P::NESTING);
    println!("{name}, {nesting}: {runs} runs of {sets} sets and kinds, {seconds:.1} s");
}

const FASTEST: u32 = 3;

fn sets_of<const L: usize>(fastest: u32) -> impl Iterator<Item = [u32; L]> {
    let all = (0..fastest.pow(L as u32)).map(move |mut code| {
        std::array::from_fn(|_| {
            let rate = code % fastest + 1;
            code /= fastest;
            rate
        })
    });
    all.filter(|rates: &[u32; L]| {
        let divisor = rates.iter().fold(0, |divisor, &rate| {
            greatest_common_divisor(divisor, u64::from(rate))
        });
        rates.is_sorted() && divisor == 1
    })
}

/// Runs of two hyperperiods, in which nobody but the loops does anything.
struct Plain;

impl Program for Plain {
    fn explore<P: Simulated, const L: usize>(&self, set: &Set<L>, kind: Kind) -> u64 {
        explore(INTERRUPTS, |plan| {
            World::<P, L>::run(
                set,
                kind,
                plan,
                |_, _| {},
                |world| {
                    world.ask(Asked::Start);
                    world.wait_until(END);
                    world.check_end();
                },
            );
        })
    }
}

/// Where the timer cannot interrupt the fastest loop, that outlasts two events.
struct Slow;

impl Program for Slow {
    fn explore<P: Simulated, const L: usize>(&self, set: &Set<L>, kind: Kind) -> u64 {
        explore(INTERRUPTS, |plan| {
            World::<P, L>::run(
                set,
                kind,
                plan,
                |world, number| {
                    if number == L - 1 {
                        world.outlast_events(2);
                    }
                },
                |world| {
                    world.ask(Asked::Start);
                    // The loop is quick again after the end of the two hyperperiods.
                    world.wait_until(2 * END);
                    world.check_end();
                },
            );
        })
    }
}

/// The background disables, enables, stops and starts, once each.
struct Controlled;

impl Program for Controlled {
    fn explore<P: Simulated, const L: usize>(&self, set: &Set<L>, kind: Kind) -> u64 {
        explore(INTERRUPTS, |plan| {
            World::<P, L>::run(
                set,
                kind,
                plan,
                |_, _| {},
                |world| {
                    world.ask(Asked::Start);
                    world.ask(Asked::Disable(0));
                    world.wait_until(END / 4);
                    world.ask(Asked::Enable(0));
                    world.ask(Asked::Disable(L - 1));
                    world.ask(Asked::Enable(L - 1));
                    world.wait_until(END / 2);
                    world.ask(Asked::Stop);
                    world.ask(Asked::Start);
                    world.wait_until(END);
                    world.check_end();
                },
            );
        })
    }
}

/// The slowest and the fastest loop and the background share a lock; the slowest and the background
/// another one, each taken inside the other.
struct Locked {
    /// Whether loops change their places while locks are used.
    rates_change: bool,
}

impl Program for Locked {
    fn explore<P: Simulated, const L: usize>(&self, set: &Set<L>, kind: Kind) -> u64 {
        let (slowest, fastest) = (0, L - 1);
        let (wide_users, narrow_users) = ([slowest, fastest], [slowest]);
        let id = |number: usize| LoopId(number as u8);
        explore(INTERRUPTS, |plan| {
            let wide = LoopLock::new(&wide_users.map(id), 0);
            let narrow = LoopLock::new(&narrow_users.map(id), 0);
            let taken = std::sync::atomic::AtomicU32::new(0);
            let count = || taken.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            World::<P, L>::run(
                set,
                kind,
                plan,
                |world, number| {
                    if number == slowest {
                        world.increment(&wide, &wide_users, || {
                            world.increment(&narrow, &narrow_users, || {});
                        });
                        count();
                    } else if number == fastest {
                        world.increment(&wide, &wide_users, || {});
                        count();
                    }
                },
                |world| {
                    world.ask(Asked::Start);
                    if self.rates_change {
                        let all = world
                            .scheduler
                            .set_rate(id(slowest), Rate::hz(set.rates[fastest]));
                        all.expect("it fits");
                        let all = world
                            .scheduler
                            .set_rate(id(fastest), Rate::hz(set.rates[slowest]));
                        all.expect("it fits");
                    }
                    world.increment(&narrow, &narrow_users, || {
                        world.increment(&wide, &wide_users, || {});
                    });
                    count();
                    world.wait_until(END);
                    world.check_end();
                },
            );
            assert_eq!(
                { wide }.get_mut(),
                &mut taken.load(std::sync::atomic::Ordering::Relaxed)
            );
        })
    }
}

const ALL_KINDS: [Kind; 3] = [Kind::OnTime, Kind::Late, Kind::WithoutCause];

#[test]
fn loops_that_skip() {
    with_all_sets("skip", &Plain, &ALL_KINDS, Overrun::Skip);
}

#[test]
fn loops_that_catch_up() {
    with_all_sets(
        "catch up",
        &Plain,
        &[Kind::OnTime, Kind::Late],
        Overrun::CatchUp(1),
    );
}

#[test]
fn loops_that_outlast_events_in_the_timers_vector() {
    for overrun in [Overrun::Skip, Overrun::CatchUp(1), Overrun::Fault] {
        with_all_sets_on::<Vectored>("slow", &Slow, &[Kind::OnTime], overrun);
    }
}

#[test]
fn loops_that_fault() {
    with_all_sets("fault", &Plain, &[Kind::OnTime], Overrun::Fault);
}

#[test]
fn loops_that_are_controlled() {
    with_all_sets("control", &Controlled, &[Kind::OnTime], Overrun::CatchUp(1));
}

#[test]
fn loops_that_share_data() {
    let program = Locked {
        rates_change: false,
    };
    with_all_sets("locks", &program, &[Kind::OnTime], Overrun::Skip);
}

#[test]
fn loops_that_share_data_and_change_places() {
    let program = Locked { rates_change: true };
    with_all_sets("locks and rates", &program, &[Kind::OnTime], Overrun::Skip);
}
