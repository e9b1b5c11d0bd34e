//! The queue of motions while everything is killed: each request runs once, or is reported as lost.
//!
//! `CONDOR_ENQUEUES=1000 cargo test --release -p utah-mit-hand --test queue`
//!
//! Three clients, processes of the system, enqueue motions at the master, each motion with a target of
//! its own. Meanwhile `kill -9` ends clients, the master's program and the supervisor at random instants;
//! the death of the supervisor ends all programs, and the system is brought up again from the same files.
//! A further program watches the set-points of every tick. At the end what the clients were told of each
//! request is compared with what the set-points have shown. `CONDOR_ENQUEUES` is the number of requests,
//! by default 60, and `CONDOR_SEED` begins the random sequence. Time is simulated.
//!
//! `CONDOR_ROUNDS=100 CONDOR_CLOCK=real cargo test --release -p utah-mit-hand --test queue`
//!
//! attacks the whole system instead, in so many [rounds](attack), by the `real` or the `simulated` clock.

mod attack;
mod client;
mod system;

use std::process::ExitCode;
use std::time::{Duration, Instant};

use condor_robot::program::RobotApplication;
use condor_rt::linux;
use utah_mit_boards::robot::PROCESSES;
use verdict::log::PLACE;
use verdict::observer::Observer;

use client::Client;
use system::{Clock, KEEPER, Outcome, SUPERVISOR, Up};

/// The whole run may take so long on a machine that has much else to do, and so much per request.
const PATIENCE: Duration = Duration::from_secs(300);
const PATIENCE_EACH: Duration = Duration::from_secs(5);

/// The hand, with the programs that enqueue motions and watch.
const HAND: RobotApplication = RobotApplication::new("system.toml", &PROCESSES).with_programs(&[
    ("client", |arguments| linux::run(&Client, arguments)),
    ("observer", |arguments| linux::run(&Observer, arguments)),
]);

fn main() -> ExitCode {
    // What the test starts is this program, too.
    if std::env::var_os(PLACE).is_some() {
        return HAND.run();
    }
    // Like a test of this name.
    let mut words = std::env::args().skip(1);
    if words.any(|word| word == "--list" || !word.starts_with('-') && !"queue".contains(&word)) {
        return ExitCode::SUCCESS;
    }
    let seed = number("CONDOR_SEED", 1);
    let random = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let outcome = match number("CONDOR_ROUNDS", 0) {
        0 => run(number("CONDOR_ENQUEUES", 60), random),
        rounds => attack::run(rounds, clock(), random),
    };
    match outcome {
        Ok(wrong) if wrong.is_empty() => ExitCode::SUCCESS,
        Ok(wrong) => {
            for wrong in wrong {
                println!("WRONG (seed {seed}): {wrong}");
            }
            ExitCode::FAILURE
        }
        Err(error) => {
            println!("FAILED (seed {seed}): {error}");
            ExitCode::FAILURE
        }
    }
}

fn clock() -> Clock {
    match std::env::var("CONDOR_CLOCK").as_deref() {
        Ok("real") => Clock::Real,
        Ok("simulated") | Err(_) => Clock::Simulated,
        Ok(other) => panic!("CONDOR_CLOCK is `{other}`; it must be `real` or `simulated`"),
    }
}

fn number(name: &str, usual: u64) -> u64 {
    let text = std::env::var(name).ok();
    text.map_or(usual, |text| text.parse().expect("a number"))
}

/// Numbers that look random, the same ones in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// Runs everything; returns all that is not as it should be.
fn run(requests: u64, mut random: Random) -> Outcome<Vec<String>> {
    let began = Instant::now();
    let patience = PATIENCE + PATIENCE_EACH * u32::try_from(requests)?;
    let mut up = Up::new(requests, Clock::Simulated)?;
    let mut kills = [0_u32; 3];
    let mut next = Instant::now();
    while !up.is_done() {
        if began.elapsed() > patience {
            return Err(format!("no end within {patience:?}:\n{}", up.told()).into());
        }
        up.look()?;
        if Instant::now() >= next {
            let (what, victim) = match random.below(16) {
                0 => (2, [SUPERVISOR, KEEPER][usize::from(random.below(2) == 0)]),
                1..5 => (1, "master"),
                5..9 => (0, "client-a"),
                9..13 => (0, "client-b"),
                _ => (0, "client-c"),
            };
            kills[what] += u32::from(up.kill(victim));
            next = Instant::now() + Duration::from_millis(50 + random.below(700));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    up.end(began + patience)?;
    let verdict = verdict::of(up.place())?;
    let [clients, master, supervisor] = kills;
    println!(
        "{requests} enqueues, {:.0} s: {clients} kills of clients, {master} of the master, \
         {supervisor} of the supervisor\n{verdict}",
        began.elapsed().as_secs_f64()
    );
    Ok(verdict.wrong_of(requests))
}
