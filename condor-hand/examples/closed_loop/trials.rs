//! What a hand that is under control must do, on any plant.

use condor_hand::math::{max, min};
use condor_hand::trajectory::{Polynomial, SetPoint};

use super::rig::{Configuration, FINGERS, JOINTS, OfJoints, Plant, Result, Rig, posture};

/// From where the joints are to where they go, rad: 11 to 34 degrees.
const STROKE: [f64; JOINTS] = [0.2, 0.6, 0.5, 0.4];
const STROKE_S: f64 = 0.4;
/// When a motion is judged to be over, after its beginning, s.
const SETTLED_S: f64 = 0.6;

/// What a trial may leave.
pub(crate) struct Goals {
    /// The largest error of any joint on the way, degrees.
    pub(crate) peak_deg: f64,
    /// The largest error 0.6 s after the beginning of a motion of 0.4 s, degrees.
    pub(crate) settled_deg: f64,
    /// The largest range that a joint goes through at rest, degrees.
    pub(crate) restless_deg: f64,
    /// The largest range that the command of a tendon goes through at rest, N.
    pub(crate) restless_n: f64,
    /// How far below the least tension of the configuration a tendon at rest may come, N.
    pub(crate) slack_n: f64,
}

pub(crate) const GOALS: Goals = Goals {
    peak_deg: 2.5,
    settled_deg: 0.05,
    restless_deg: 0.01,
    restless_n: 0.2,
    slack_n: 0.1,
};

/// What a trial has left.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    /// On the way, degrees.
    pub(crate) peak_deg: OfJoints<f64>,
    /// 0.6 s after the beginning, degrees.
    pub(crate) settled_deg: OfJoints<f64>,
    /// The range at rest, degrees.
    pub(crate) restless_deg: OfJoints<f64>,
    /// The range of the commands at rest, N.
    pub(crate) restless_n: OfJoints<f64>,
    /// The least tension at rest, N.
    pub(crate) least_n: OfJoints<f64>,
    /// The least that the configuration asks for, N.
    pub(crate) asked_n: f64,
}

impl Errors {
    pub(crate) fn keep(&self, goals: &Goals) -> bool {
        largest(&self.peak_deg) <= goals.peak_deg
            && largest(&self.settled_deg) <= goals.settled_deg
            && self.is_at_rest(goals)
            && -largest(&self.least_n.map(|finger| finger.map(|n| -n)))
                >= self.asked_n - goals.slack_n
    }

    /// A limit cycle moves the joints, or else it moves the commands.
    pub(crate) fn is_at_rest(&self, goals: &Goals) -> bool {
        largest(&self.restless_deg) <= goals.restless_deg
            && largest(&self.restless_n) <= goals.restless_n
    }
}

pub(crate) fn largest(all: &OfJoints<f64>) -> f64 {
    all.iter().flatten().copied().fold(f64::MIN, max)
}

/// All joints go by [`STROKE`] and come back, the third and fourth finger the other way round; each
/// way is followed by a rest, in the last part of which it must be quiet.
pub(crate) fn strokes<P: Plant>(configuration: &Configuration, plant: P) -> Result<Errors> {
    let mut rig = Rig::new(configuration, plant)?;
    let here: OfJoints<f64> = [posture(); FINGERS];
    let there: OfJoints<f64> = std::array::from_fn(|finger| {
        let sense = if finger < 2 { 1.0 } else { -1.0 };
        std::array::from_fn(|joint| here[finger][joint] + sense * STROKE[joint])
    });
    let mut errors = Errors {
        least_n: [[f64::MAX; JOINTS]; FINGERS],
        asked_n: configuration
            .fingers
            .iter()
            .flat_map(|finger| &finger.joints)
            .map(|joint| joint.tension_range().0)
            .fold(f64::MAX, min),
        ..Errors::default()
    };
    // Tensions come up first.
    stroke(&mut rig, &here, &here, &mut Errors::default())?;
    stroke(&mut rig, &here, &there, &mut errors)?;
    stroke(&mut rig, &there, &here, &mut errors)?;
    Ok(errors)
}

/// A configuration with other numbers of its servos.
pub(crate) fn tuned(configuration: &Configuration, tuning: &Tuning) -> Configuration {
    let mut tuned = configuration.clone();
    for finger in &mut tuned.fingers {
        for joint in &mut finger.joints {
            joint.servo.bandwidth_hz = tuning.bandwidth_hz;
            joint.servo.velocity_cutoff_hz = tuning.velocity_cutoff_hz;
            joint.flexor.gains.kt = tuning.kt;
            joint.extensor.gains.kt = tuning.kt;
        }
    }
    tuned
}

/// Numbers of all servos.
pub(crate) struct Tuning {
    /// The natural frequency of the joints, Hz.
    pub(crate) bandwidth_hz: f64,
    /// Of the filter that makes rates of positions, Hz.
    pub(crate) velocity_cutoff_hz: f64,
    /// The gain of the tension servos.
    pub(crate) kt: f64,
}

/// Rest begins this long after the beginning of the stroke and is watched for as long, s.
const REST_S: f64 = 1.0;
const WATCH_S: f64 = 0.5;

fn stroke<P: Plant>(
    rig: &mut Rig<P>,
    from: &OfJoints<f64>,
    to: &OfJoints<f64>,
    errors: &mut Errors,
) -> Result<()> {
    let mut seen = [[Range::default(); JOINTS]; FINGERS];
    let mut commanded = [[(Range::default(), Range::default()); JOINTS]; FINGERS];
    let ticks_per_master = rig.substeps();
    let per_s = f64::from(ticks_per_master) / rig.master_period_s();
    let ticks = rig.ticks_in(REST_S + WATCH_S);
    for tick in 0..ticks {
        let now = f64::from(tick) / per_s;
        if tick % ticks_per_master == 0 {
            // Of the next tick of the master, in one period of it.
            let then = now + rig.master_period_s();
            rig.follow(&points(from, to, then)?)?;
        }
        let before = rig.state;
        let done = rig.tick()?;
        for (finger, (done, sensed)) in done.iter().zip(&before).enumerate() {
            for joint in 0..JOINTS {
                let target = done.target[joint].ok_or("a joint has no set-point")?;
                let error = (target - sensed.position[joint]).to_degrees().abs();
                let peak = &mut errors.peak_deg[finger][joint];
                *peak = max(*peak, error);
                if (now - SETTLED_S).abs() < 0.5 / per_s {
                    let settled = &mut errors.settled_deg[finger][joint];
                    let end = (to[finger][joint] - sensed.position[joint]).to_degrees();
                    *settled = max(*settled, end.abs());
                }
                if now >= REST_S {
                    seen[finger][joint].include(sensed.position[joint].to_degrees());
                    let command = done.output.command[joint];
                    let (flexor, extensor) = &mut commanded[finger][joint];
                    flexor.include(command.flexor);
                    extensor.include(command.extensor);
                    let tension = sensed.tension[joint];
                    let least = &mut errors.least_n[finger][joint];
                    *least = min(*least, min(tension.flexor, tension.extensor));
                }
            }
        }
    }
    for finger in 0..FINGERS {
        for joint in 0..JOINTS {
            let range = &mut errors.restless_deg[finger][joint];
            *range = max(*range, seen[finger][joint].width());
            let (flexor, extensor) = &commanded[finger][joint];
            let range = &mut errors.restless_n[finger][joint];
            *range = max(*range, max(flexor.width(), extensor.width()));
        }
    }
    Ok(())
}

/// The set-points of all joints at a time after the beginning of a stroke.
fn points(
    from: &OfJoints<f64>,
    to: &OfJoints<f64>,
    time_s: f64,
) -> Result<OfJoints<SetPoint<f64>>> {
    let mut points = [[SetPoint::default(); JOINTS]; FINGERS];
    for (points, (from, to)) in points.iter_mut().zip(from.iter().zip(to)) {
        for (point, (&from, &to)) in points.iter_mut().zip(from.iter().zip(to)) {
            let (from, to) = (SetPoint::rest(from), SetPoint::rest(to));
            *point = Polynomial::quintic(&from, &to, STROKE_S)?.at(min(time_s, STROKE_S));
        }
    }
    Ok(points)
}

/// Where a value has been.
#[derive(Clone, Copy)]
struct Range {
    low: f64,
    high: f64,
}

impl Default for Range {
    fn default() -> Self {
        Self {
            low: f64::MAX,
            high: f64::MIN,
        }
    }
}

impl Range {
    fn include(&mut self, value: f64) {
        self.low = min(self.low, value);
        self.high = max(self.high, value);
    }

    fn width(&self) -> f64 {
        self.high - self.low
    }
}
