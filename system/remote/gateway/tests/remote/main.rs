//! The hand in simulated time, with a gateway and clients as processes.
//!
//! `basics` looks, tunes and moves, is refused, and leaves. `kills` has three clients enqueue motions while `kill -9`
//! ends clients, the router, the gateway, the master and the supervisor, and a proxy cuts connections: what the clients
//! were told of each motion must agree with the set-points of every tick. `partitions` is the same on three hosts,
//! which are network namespaces with slow and lossy links that part; it needs root and iproute2.
//! `CONDOR_REMOTE_MOTIONS` is the number of motions, by default 40, and `CONDOR_SEED` begins the random sequence:
//!
//! `CONDOR_REMOTE_MOTIONS=2000 cargo test -p condor-gateway --test remote`

mod basics;
mod between;
mod client;
mod hosts;
mod kills;
mod proxy;
mod random;
mod system;

use std::process::ExitCode;

use condor_robot::program::RobotApplication;
use condor_rt::linux;
use utah_mit_boards::robot::PROCESSES;
use verdict::log::PLACE;
use verdict::observer::Observer;

use system::Outcome;

/// A test.
type Test = fn() -> Outcome<()>;

/// The hand, with a program that watches, and clients and routers as commands.
const HAND: RobotApplication = RobotApplication::new("system.toml", &PROCESSES)
    .with_programs(&[("observer", |arguments| linux::run(&Observer, arguments))])
    .with_commands(&[
        ("client", "Enqueues motions", |arguments| {
            ends(client::run(&arguments))
        }),
        ("router", "Is a router", |arguments| {
            ends(kills::route(&arguments))
        }),
    ]);

fn ends(result: Outcome<()>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn main() -> ExitCode {
    // What the test starts is this program, too.
    if std::env::var_os(PLACE).is_some() {
        return HAND.run();
    }
    let words: Vec<_> = std::env::args().skip(1).collect();
    if words.iter().any(|word| word == "--list") {
        return ExitCode::SUCCESS;
    }
    let filter = words.iter().find(|word| !word.starts_with('-'));
    let tests: [(&str, Test); 3] = [
        ("basics", basics::run),
        ("kills", kills::with_proxies),
        ("partitions", kills::with_hosts),
    ];
    let mut failed = false;
    for (name, test) in tests {
        if filter.is_none_or(|filter| name.contains(filter.as_str())) {
            let result = test();
            let word = if result.is_ok() { "ok" } else { "FAILED" };
            println!("test {name} ... {word}");
            if let Err(error) = result {
                println!("{error}");
                failed = true;
            }
        }
    }
    if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    }
}
