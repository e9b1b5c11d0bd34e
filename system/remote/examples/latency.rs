//! Takes all streams of rows of a robot on this machine, and measures how old rows are when they arrive:
//! `latency ADDRESS CLIENT ROBOT`.
//!
//! The example prints the number of streams. Then it counts rows, from the first line of its standard input until the
//! end of the input. At last it prints JSON: the number of `rows`, of those that were `lost`, and the `median_us` and
//! `p99_us` of the times from the release of the loop's tick to the arrival of its row, in µs.

use std::error::Error;
use std::io::{Read, stdin};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU8, Ordering};
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use condor_remote::{Network, Remote, RemoteAccess, RemoteStream};
use serde_json::json;

type AnyError = Box<dyn Error + Send + Sync>;

/// The longest time that anything may take to start.
const PATIENCE: Duration = Duration::from_secs(30);
/// The longest time between two looks whether to end.
const LOOK: Duration = Duration::from_millis(100);

/// Not counting yet, counting, and done.
static PHASE: AtomicU8 = AtomicU8::new(0);

/// The rows of a stream: their ages in ns, and the number of lost ones.
#[derive(Default)]
struct Taken {
    ages_ns: Vec<u64>,
    lost: u64,
}

fn take(mut stream: RemoteStream) -> Result<Taken, AnyError> {
    let mut taken = Taken::default();
    loop {
        let message = stream.next(LOOK)?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH)?;
        // Relaxed: the phase orders no other memory.
        match PHASE.load(Ordering::Relaxed) {
            0 => continue,
            1 => {}
            _ => return Ok(taken),
        }
        let Some(message) = message else { continue };
        let row = stream.row(&message)?.ok_or("an event among rows")?;
        let head = row.head();
        let age = (now.as_nanos() as u64).saturating_sub(head.stamp.as_ns());
        taken.ages_ns.push(age);
        taken.lost += head.lost + message.lost;
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), AnyError> {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let [place, client, robot] = &words[..] else {
        return Err("expected an address, the name of a client, and the name of a robot".into());
    };
    let network = Network::open(&RemoteAccess::to(place), client, PATIENCE)?;
    let remote = Remote::new(&network, robot)?;
    let (mut threads, mut variables) = (Vec::new(), 0);
    let begun = Instant::now();
    while threads.is_empty() && begun.elapsed() < PATIENCE {
        // A gateway that has just begun has none yet.
        for topic in remote.topics(PATIENCE)?.iter().filter(|it| it.has_rows) {
            let stream = remote.subscribe(&topic.name, PATIENCE)?;
            variables += stream.columns().count();
            threads.push(thread::spawn(move || take(stream)));
        }
    }
    println!("{} streams of {variables} variables", threads.len());
    stdin().read_line(&mut String::new())?;
    PHASE.store(1, Ordering::Relaxed);
    stdin().read_to_end(&mut Vec::new())?;
    PHASE.store(2, Ordering::Relaxed);
    let mut all = Taken::default();
    for thread in threads {
        let taken = thread.join().map_err(|_| "a stream has panicked")??;
        all.ages_ns.extend(taken.ages_ns);
        all.lost += taken.lost;
    }
    all.ages_ns.sort_unstable();
    let rank = |part: usize| {
        let rank = (all.ages_ns.len() * part).div_ceil(100).max(1) - 1;
        all.ages_ns.get(rank).map(|&ns| ns / 1000)
    };
    let result = json!({
        "rows": all.ages_ns.len(),
        "lost": all.lost,
        "median_us": rank(50),
        "p99_us": rank(99),
    });
    println!("{result}");
    Ok(())
}
