//! A plan as the page gets it.

use serde_json::{Value as Json, json};

use condor_host::robot::{JointPlan, Plan};

/// The greatest number of samples of a curve.
const SAMPLES: usize = 1000;

/// Returns a plan whose curves have as many samples as a page can draw.
#[allow(
    clippy::cast_precision_loss,
    reason = "a plan has fewer ticks than 2^52"
)]
pub(super) fn plan_json(plan: &Plan) -> Json {
    let ticks = plan.joints.first().map_or(0, |joint| joint.position.len());
    let steps = ticks.saturating_sub(1);
    let every = steps.div_ceil(SAMPLES - 1).max(1);
    let joints = plan.joints.iter().map(|joint| curves(joint, every));
    let peaks = plan.joints.iter().map(|joint| {
        let peaks = joint.peaks();
        json!({
            "joint": joint.name,
            "velocity": peaks.velocity,
            "torque": peaks.torque,
            "effort": peaks.effort,
        })
    });
    json!({
        "period": every as f64 * plan.period_s,
        "duration": steps as f64 * plan.period_s,
        "joints": joints.collect::<Vec<_>>(),
        "peaks": peaks.collect::<Vec<_>>(),
        "events": plan.events,
        "overloads": plan.overloads,
        "collisions": plan.collisions,
    })
}

/// Returns the curves of a joint: of every so many ticks, and of the last one.
fn curves(joint: &JointPlan, every: usize) -> Json {
    let actuators = joint.actuators.iter().map(|actuator| {
        json!({
            "name": actuator.name,
            "effort": thinned(&actuator.effort, every),
            "limits": actuator.limits,
        })
    });
    json!({
        "name": joint.name,
        "position": thinned(&joint.position, every),
        "velocity": thinned(&joint.velocity, every),
        "torque": thinned(&joint.torque, every),
        "limits": {
            "position": joint.position_limits,
            "velocity": joint.velocity_limit,
            "torque": joint.torque_limits,
        },
        "actuators": actuators.collect::<Vec<_>>(),
    })
}

fn thinned<T: Copy>(values: &[T], every: usize) -> Vec<T> {
    let is_last_left = values.len() % every != 1 % every;
    let last = values.last().filter(|_| is_last_left);
    values.iter().step_by(every).chain(last).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_have_a_thousand_samples_and_the_last_one() {
        for (ticks, samples) in [
            (1, 1),
            (1000, 1000),
            (1001, 501),
            (1002, 502),
            (20_001, 954),
        ] {
            let values: Vec<usize> = (0..ticks).collect();
            let steps = values.len() - 1;
            let every = steps.div_ceil(SAMPLES - 1).max(1);
            let thinned = thinned(&values, every);
            assert_eq!(thinned.len(), samples, "{ticks}");
            assert_eq!(thinned.last(), values.last());
            let pairs = thinned.windows(2);
            let [rest @ .., _] = &pairs.map(|it| it[1] - it[0]).collect::<Vec<_>>()[..] else {
                continue;
            };
            assert!(rest.iter().all(|it| *it == every), "{ticks}");
        }
    }
}
