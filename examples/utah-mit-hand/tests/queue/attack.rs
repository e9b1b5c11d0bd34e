//! [`run`]: rounds in which the system comes up, is attacked, and goes down at a random moment.
//!
//! Up to three strikes fall in a round: a process, the supervisor and its keeper among them, is killed, or
//! stopped for 50 ms to 2 s. Then somebody takes the system down, by `down` or by an interrupt, though
//! processes may be stopped, or the supervisor dead. Each time everything must have ended within
//! [`DOWN`], whoever had started it, and the next round goes on with the files of the former one. Clients enqueue
//! motions all the while. After the last round they may ask for what they do not know yet, and what they were told is
//! compared with what was observed.

use std::fs;
use std::time::{Duration, Instant};

use condor_host::control::DOWN;
use rustix::process::{Signal, kill_process};

use crate::client::ENOUGH;
use crate::system::{Clock, KEEPER, Outcome, SUPERVISOR, Up};
use crate::{PATIENCE, Random};
use verdict::log::CLIENTS;

const PROGRAMS: [&str; 6] = [
    "master",
    "plant",
    "servo-a",
    "servo-b",
    "table",
    "terminals",
];
const LOOK: Duration = Duration::from_millis(5);

/// The kills and stops of all rounds, and the time that the system took to go down in each.
#[derive(Default)]
struct Report {
    kills: u32,
    stops: u32,
    /// Those of the kills and stops that befell the supervisor or its keeper.
    of_supervisor: u32,
    downs: Vec<Duration>,
    /// Until when the supervisor or its keeper is stopped.
    deaf: Option<Instant>,
    wrong: Vec<String>,
}

/// Makes so many rounds; returns all that is not as it should be.
pub(crate) fn run(rounds: u64, clock: Clock, mut random: Random) -> Outcome<Vec<String>> {
    let began = Instant::now();
    // More requests than they have time for.
    let mut up = Up::new(30_000, clock)?;
    let mut report = Report::default();
    for number in 1..=rounds {
        if let Err(error) = round(&mut up, &mut random, &mut report) {
            return Err(format!("round {number}: {error}\n{}", up.told()).into());
        }
    }
    // In peace they ask for the outcomes that they do not know.
    fs::write(up.place().join(ENOUGH), "")?;
    let deadline = Instant::now() + PATIENCE;
    while !up.is_done() {
        if Instant::now() > deadline {
            return Err(format!("no end within {PATIENCE:?}:\n{}", up.told()).into());
        }
        up.look()?;
        std::thread::sleep(LOOK);
    }
    up.end(deadline)?;
    let verdict = verdict::of(up.place())?;
    report.downs.sort();
    let of_all = |part: usize| report.downs[(report.downs.len() - 1) * part / 100].as_secs_f64();
    println!(
        "{rounds} rounds, {clock:?} clock, {:.0} s: {} kills and {} stops, {} of them of the supervisor or its keeper; \
         went down in {:.1} s (median), {:.1} s (the longest)\n{verdict}",
        began.elapsed().as_secs_f64(),
        report.kills,
        report.stops,
        report.of_supervisor,
        of_all(50),
        of_all(100),
    );
    let mut wrong = report.wrong;
    if verdict.count("Done") == 0 {
        wrong.push("no request was done".into());
    }
    wrong.extend(verdict.wrong);
    Ok(wrong)
}

fn round(up: &mut Up, random: &mut Random, report: &mut Report) -> Outcome<()> {
    up.look()?;
    let deadline = Instant::now() + PATIENCE;
    while up.status().is_none() {
        if Instant::now() > deadline || up.has_ended()? {
            return Err("it did not come up".into());
        }
        std::thread::sleep(LOOK);
    }
    // Its programs may still be starting.
    let mut strikes: Vec<_> = (0..=random.below(3)).map(|_| moment(random)).collect();
    strikes.sort();
    let end = moment(random).max(strikes[0]);
    while Instant::now() < end {
        if strikes
            .first()
            .is_some_and(|strike| Instant::now() > *strike)
        {
            strikes.remove(0);
            strike(up, random, report);
        }
        if !up.has_ended()? {
            up.look()?;
        }
        std::thread::sleep(LOOK);
    }
    let took = down(up, random.below(2) == 0, report.deaf.take())?;
    if took > DOWN {
        let took = took.as_secs_f64();
        report.wrong.push(format!("it went down in {took:.1} s"));
    }
    report.downs.push(took);
    Ok(())
}

fn moment(random: &mut Random) -> Instant {
    Instant::now() + Duration::from_millis(random.below(3000))
}

/// Kills a process, or stops it for a while.
fn strike(up: &Up, random: &mut Random, report: &mut Report) {
    let names: Vec<_> = PROGRAMS
        .into_iter()
        .chain(CLIENTS)
        .chain([SUPERVISOR, KEEPER])
        .collect();
    let pick = usize::try_from(random.below(names.len() as u64)).unwrap_or(0);
    let (name, kills) = (names[pick], random.below(2) == 0);
    let length = Duration::from_millis(50 + random.below(1950));
    let Some(process) = up.process(name) else {
        return;
    };
    let signal = if kills { Signal::KILL } else { Signal::STOP };
    if kill_process(process, signal).is_err() {
        return;
    }
    let is_of_supervisor = [SUPERVISOR, KEEPER].contains(&name);
    report.of_supervisor += u32::from(is_of_supervisor);
    if kills {
        report.kills += 1;
        return;
    }
    report.stops += 1;
    if is_of_supervisor {
        report.deaf = report.deaf.max(Some(Instant::now() + length));
    }
    std::thread::spawn(move || {
        std::thread::sleep(length);
        // It may have ended.
        let _ = kill_process(process, Signal::CONT);
    });
}

/// Takes the system down, and waits until nothing of it is left. Returns how long that took, from the moment at
/// which it was told, or from that until which it is deaf.
fn down(up: &mut Up, by_signal: bool, deaf: Option<Instant>) -> Outcome<Duration> {
    let deadline = Instant::now() + PATIENCE;
    let mut told = Instant::now();
    let mut command = up.begin_down(by_signal)?;
    loop {
        let left = up.processes()?;
        if up.has_ended()? && left.is_empty() {
            let from = deaf.map_or(told, |deaf| deaf.max(told));
            return Ok(from.elapsed());
        }
        if Instant::now() > deadline {
            let left = left.len();
            return Err(format!("{left} processes stay after {PATIENCE:?}").into());
        }
        if let Some(child) = &mut command
            && let Some(status) = child.try_wait()?
        {
            command = None;
            if !status.success() && !up.has_ended()? {
                // There was no supervisor that it could tell.
                told = Instant::now();
                command = up.begin_down(by_signal)?;
            }
        }
        std::thread::sleep(LOOK);
    }
}
