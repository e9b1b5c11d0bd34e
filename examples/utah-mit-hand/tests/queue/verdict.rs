//! [`of`]: what the clients were told, against what was observed.

use std::collections::BTreeMap;
use std::path::Path;

use utah_mit_hand::compile::read_hand;

use crate::client::{self, CLIENTS, JOINTS, Line, target};
use crate::observer::{self, Sample};
use crate::system::{Outcome, PACKAGE};

/// Set-points are as exact as this, rad.
const EXACT: f64 = 1e-9;

/// What has been seen of a request.
#[derive(Clone, Copy, Default)]
struct Observed {
    /// How often its joint came to rest at its target.
    rests: u32,
    /// How often the last set-points before a gap went to the target.
    gaps: u32,
}

/// Returns the counts of outcomes as text, and all that is wrong.
pub(crate) fn of(place: &Path, requests: u64) -> Outcome<(String, Vec<String>)> {
    let samples = observer::read(place);
    let mut wrong = jumps(&samples)?;
    let mut counts = BTreeMap::<String, u64>::new();
    let (mut offered, mut ran) = (0, 0);
    for (client, name) in CLIENTS.iter().enumerate() {
        let mut outcomes = BTreeMap::new();
        for line in client::read(&place.join(name)) {
            match line {
                Line::Offers(index, identity) => {
                    if outcomes.insert(index, None).is_some() {
                        wrong.push(format!("{name} offers {index} twice: {identity}"));
                    }
                }
                Line::Told(index, outcome) => match outcomes.get_mut(&index) {
                    Some(place @ None) => *place = Some(outcome),
                    other => wrong.push(format!("{name} was told {outcome} of {index}: {other:?}")),
                },
            }
        }
        offered += outcomes.len() as u64;
        for (index, outcome) in outcomes {
            let outcome = outcome.unwrap_or_else(|| "nothing".into());
            let Observed { rests, gaps } = observed(&samples, client, target(index));
            ran += u64::from(rests > 0);
            let word = outcome.split(' ').next().unwrap_or_default();
            let is_right = match word {
                "Done" => rests == 1 || rests == 0 && gaps > 0,
                // Nobody knows how far it came, or the client was away for too long.
                "BrokenOff" | "Aborted" | "Forgotten" => rests <= 1,
                "Lost" | "Refused" | "Never" => rests == 0,
                _ => false,
            };
            if !is_right {
                wrong.push(format!(
                    "request {index} of {name}: {outcome}, seen {rests} times at its target"
                ));
            }
            *counts.entry(outcome).or_default() += 1;
        }
    }
    if offered != requests {
        wrong.push(format!("{offered} requests were offered, not {requests}"));
    }
    let done = counts.get("Done None").copied().unwrap_or(0);
    let refused = counts
        .iter()
        .filter(|(what, _)| what.starts_with("Refused"));
    let refused: u64 = refused.map(|(_, count)| count).sum();
    // On a machine that has much else to do, many are refused before the hand is enabled again.
    if done * 3 < requests.saturating_sub(refused) || done * 5 < requests {
        wrong.push(format!(
            "only {done} of {requests} were done, and {refused} refused"
        ));
    }
    let text: Vec<_> = counts
        .iter()
        .map(|(what, count)| format!("{count} {what}"))
        .collect();
    let text = format!(
        "told: {}; {ran} seen at their targets, in {} ticks",
        text.join(", "),
        samples.len()
    );
    Ok((text, wrong))
}

fn is_loose(sample: &Sample, client: usize) -> bool {
    sample.loose >> (JOINTS[client] / 4) & 1 == 1
}

fn observed(samples: &[Sample], client: usize, target: f64) -> Observed {
    let mut seen = Observed::default();
    for pair in samples.windows(2) {
        let [before, now] = pair else { continue };
        let (was, is) = (before.position[client], now.position[client]);
        let moved = before.velocity[client] != 0.0;
        let is_gap = now.ticks != before.ticks + 1;
        if is_loose(before, client) {
            continue;
        }
        if is_gap && moved && (was - target).abs() < 0.1 {
            seen.gaps += 1;
        } else if !is_gap
            && moved
            && now.velocity[client] == 0.0
            && (is - target).abs() < EXACT
            && !is_loose(now, client)
        {
            seen.rests += 1;
        }
    }
    seen
}

/// The set-points of fingers that follow must not jump.
fn jumps(samples: &[Sample]) -> Outcome<Vec<String>> {
    let hand = Path::new(PACKAGE).join("../../condor-hand/hands/utah-mit.toml");
    let hand = read_hand(&hand)?;
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
