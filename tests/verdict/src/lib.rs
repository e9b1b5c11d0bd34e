//! For tests in which clients enqueue motions while everything is killed: what the clients were told, against what was
//! observed, as [`of`] finds it.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt;
use std::path::Path;

pub mod log;
pub mod observer;

use condor_robot::compile::read_robot;
use log::{CLIENTS, JOINTS, Line, target};
use observer::Sample;

/// Set-points are as exact as this, rad.
const EXACT: f64 = 1e-9;

/// The result of a test in which clients enqueue motions while programs are killed: the outcomes that clients were
/// told, compared with the set-points that were observed. [`of`] makes it.
pub struct Verdict {
    /// The number of times that each outcome was told.
    counts: BTreeMap<String, u64>,
    /// The requests that were offered.
    pub offered: u64,
    /// Those whose joint was seen at its target.
    ran: u64,
    ticks: usize,
    /// All that is wrong.
    pub wrong: Vec<String>,
}

impl Verdict {
    /// Returns the number of requests whose outcome begins with the text `outcome`, such as `Done`.
    #[must_use]
    pub fn count(&self, outcome: &str) -> u64 {
        let of_kind = self.counts.iter().filter(|(it, _)| it.starts_with(outcome));
        of_kind.map(|(_, count)| count).sum()
    }

    /// Returns a sentence for each mistake, if `requests` is the number of requests that all clients together had to
    /// make. Too few requests, or too few that were done, count as mistakes, too. The list is empty if all is right.
    #[must_use]
    pub fn wrong_of(&self, requests: u64) -> Vec<String> {
        let mut wrong = self.wrong.clone();
        if self.offered != requests {
            wrong.push(format!(
                "{} requests were offered, not {requests}",
                self.offered
            ));
        }
        // On a machine that has much else to do, many are refused before the hand is enabled again.
        let (done, refused) = (self.count("Done"), self.count("Refused"));
        if done * 3 < requests.saturating_sub(refused) || done * 5 < requests {
            wrong.push(format!(
                "only {done} of {requests} were done, and {refused} refused"
            ));
        }
        wrong
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} offered; told: ", self.offered)?;
        for (outcome, count) in &self.counts {
            write!(f, "{count} {outcome}, ")?;
        }
        write!(
            f,
            "{} seen at their targets, in {} ticks",
            self.ran, self.ticks
        )
    }
}

/// Judges a test: compares the outcomes that the clients were told with the set-points that were observed. `place` is
/// the directory with the logs of the clients and of the observer.
///
/// # Errors
/// Returns [`CompileError`](condor_robot::compile::CompileError) if the configuration of the hand cannot be read.
pub fn of(place: &Path) -> Result<Verdict, Box<dyn Error>> {
    let samples = observer::read(place);
    let mut wrong = jumps(&samples)?;
    let mut counts = BTreeMap::<String, u64>::new();
    let (mut offered, mut ran) = (0, 0);
    for (client, name) in CLIENTS.iter().enumerate() {
        let mut outcomes = BTreeMap::new();
        for line in log::read(&place.join(name)) {
            match line {
                Line::Offers(index, session, number) => {
                    if outcomes.insert(index, None).is_some() {
                        wrong.push(format!("{name} offers {index} twice: {session}.{number}"));
                    }
                }
                Line::Told(index, outcome) => match outcomes.get_mut(&index) {
                    Some(place @ None) => *place = Some(outcome),
                    other => wrong.push(format!("{name} was told {outcome} of {index}: {other:?}")),
                },
            }
        }
        offered += outcomes.len() as u64;
        let observed = Observed::of(&samples, client);
        for (index, outcome) in &outcomes {
            let outcome = outcome.as_deref().unwrap_or("nothing");
            let rests = observed.rests(*index);
            ran += u64::from(!rests.is_empty());
            let word = outcome.split(' ').next().unwrap_or_default();
            let is_right = match word {
                "Done" => rests.len() == 1 || rests.is_empty() && observed.may_hide(*index),
                // Nobody knows how far it came, or the client was away for too long.
                "BrokenOff" | "Aborted" | "Forgotten" | "NoSession" => rests.len() <= 1,
                "Lost" | "Refused" | "Never" => rests.is_empty(),
                _ => false,
            };
            if !is_right {
                wrong.push(format!(
                    "request {index} of {name}: {outcome}, seen {} times at its target",
                    rests.len()
                ));
            }
            *counts.entry(outcome.into()).or_default() += 1;
        }
    }
    Ok(Verdict {
        counts,
        offered,
        ran,
        ticks: samples.len(),
        wrong,
    })
}

fn is_loose(sample: &Sample, client: usize) -> bool {
    sample.loose >> (JOINTS[client] / 4) & 1 == 1
}

/// The observed motion of a client's joint.
struct Observed {
    /// The positions at which it came to rest, in units of [`UNIT`]: the samples, and the exact positions, rad.
    rests: BTreeMap<i64, Vec<(usize, f64)>>,
    gaps: Vec<Gap>,
}

/// Samples that do not follow each other.
struct Gap {
    sample: usize,
    /// The place before it if the joint was moving, rad.
    moved_at: Option<f64>,
    /// Whether ticks were not seen: the observer had just begun, or was late. Otherwise the master had.
    is_blind: bool,
}

/// Less than what lies between two targets, rad.
const UNIT: f64 = 1e-6;

#[expect(clippy::cast_possible_truncation, reason = "places are a few rad")]
fn in_units(place: f64) -> i64 {
    (place / UNIT).round() as i64
}

impl Observed {
    fn of(samples: &[Sample], client: usize) -> Self {
        let mut rests = BTreeMap::<i64, Vec<_>>::new();
        let mut gaps = Vec::new();
        for (sample, pair) in samples.windows(2).enumerate() {
            let [before, now] = pair else { continue };
            let (was, is) = (before.position[client], now.position[client]);
            let moved = before.velocity[client] != 0.0 && !is_loose(before, client);
            if now.ticks != before.ticks + 1 {
                gaps.push(Gap {
                    sample,
                    moved_at: moved.then_some(was),
                    is_blind: now.is_first || now.ticks > before.ticks,
                });
            } else if moved && now.velocity[client] == 0.0 && !is_loose(now, client) {
                rests.entry(in_units(is)).or_default().push((sample, is));
            }
        }
        Self { rests, gaps }
    }

    /// Returns the samples at which it came to rest at the target of a request.
    fn rests(&self, index: u32) -> Vec<usize> {
        let target = target(index);
        let near = in_units(target);
        let all = self
            .rests
            .range(near - 1..=near + 1)
            .flat_map(|(_, rests)| rests);
        all.filter(|(_, place)| (place - target).abs() < EXACT)
            .map(|(sample, _)| *sample)
            .collect()
    }

    /// Whether it may have come there unseen: in a blind gap between the requests before and after it, or in the
    /// last tick of a master that was killed.
    fn may_hide(&self, index: u32) -> bool {
        let nearest = |mut indices: Box<dyn Iterator<Item = u32>>| {
            indices.find_map(|index| self.rests(index).first().copied())
        };
        let after = nearest(Box::new((0..index).rev())).unwrap_or(0);
        let before = nearest(Box::new(index + 1..index + 1000)).unwrap_or(usize::MAX);
        let target = target(index);
        self.gaps.iter().any(|gap| {
            let is_near = gap.moved_at.is_some_and(|was| (was - target).abs() < 0.1);
            is_near || gap.is_blind && (after..=before).contains(&gap.sample)
        })
    }
}

/// The set-points of fingers that follow must not jump.
fn jumps(samples: &[Sample]) -> Result<Vec<String>, Box<dyn Error>> {
    let hand = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../condor-hand/hands/utah-mit.toml");
    let hand = read_robot(&hand, &[], |_| Ok(()))?;
    let tick_s = 1.0 / f64::from(hand.trajectory_hz);
    let mut wrong = Vec::new();
    for pair in samples.windows(2) {
        let [before, now] = pair else { continue };
        if now.ticks != before.ticks + 1 {
            continue;
        }
        for (client, joint) in JOINTS.into_iter().enumerate() {
            if is_loose(before, client) || is_loose(now, client) {
                continue;
            }
            let entry = hand.joint(joint / 4, joint % 4).ok_or("no such joint")?;
            let greatest = entry.limits.velocity * tick_s;
            let step = (now.position[client] - before.position[client]).abs();
            let change = (now.velocity[client] - before.velocity[client]).abs();
            if step > greatest || change > entry.limits.acceleration * tick_s {
                wrong.push(format!("joint {joint} jumps: {before:?}, then {now:?}"));
            }
        }
    }
    Ok(wrong)
}
