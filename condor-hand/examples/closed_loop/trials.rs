//! The trials that a controlled hand must pass, on any plant.

use condor_hand::math::{max, min};
use condor_hand::trajectory::{Polynomial, SetPoint};

use super::rig::{
    ACTUATORS, Configuration, FINGERS, JOINTS, OfJoints, Plant, Result, Rig, posture,
};

/// From where the joints are to where they go, rad: 11 to 34 degrees.
const STROKE: [f64; JOINTS] = [0.2, 0.6, 0.5, 0.4];
const STROKE_S: f64 = 0.4;
/// When a motion is judged to be over, after its beginning, s.
const SETTLED_S: f64 = 0.6;
/// Rest begins this long after the beginning of the stroke and is watched for as long, s.
const REST_S: f64 = 1.0;
const WATCH_S: f64 = 0.5;

/// The errors of a trial, or their bounds: the largest of all joints.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    /// The error on the way, degrees.
    pub(crate) peak_deg: f64,
    /// The error 0.6 s after the beginning of a motion of 0.4 s, degrees.
    pub(crate) settled_deg: f64,
    /// The range that a joint goes through at rest, degrees.
    pub(crate) restless_deg: f64,
    /// The range that the command of an actuator goes through at rest, N.
    pub(crate) restless_n: f64,
    /// The greatest lack of an effort at rest below the least one of the configuration, N.
    pub(crate) short_n: f64,
}

pub(crate) const GOALS: Errors = Errors {
    peak_deg: 2.5,
    settled_deg: 0.05,
    restless_deg: 0.01,
    restless_n: 0.2,
    short_n: 0.1,
};

impl Errors {
    pub(crate) fn keep(&self, goals: &Self) -> bool {
        self.peak_deg <= goals.peak_deg
            && self.settled_deg <= goals.settled_deg
            && self.short_n <= goals.short_n
            && self.is_at_rest(goals)
    }

    /// A limit cycle moves the joints, or else it moves the commands.
    pub(crate) fn is_at_rest(&self, goals: &Self) -> bool {
        self.restless_deg <= goals.restless_deg && self.restless_n <= goals.restless_n
    }
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
    let fingers = configuration.fingers.iter();
    let actuators = fingers.flat_map(|finger| &finger.actuators);
    let least_n = actuators
        .map(|actuator| actuator.limits.low)
        .fold(f64::MAX, min);
    let mut errors = Errors {
        short_n: f64::MIN,
        ..Errors::default()
    };
    // Efforts come up first.
    stroke(&mut rig, &here, &here, least_n, &mut Errors::default())?;
    stroke(&mut rig, &here, &there, least_n, &mut errors)?;
    stroke(&mut rig, &there, &here, least_n, &mut errors)?;
    Ok(errors)
}

/// A configuration with other numbers of its servos.
pub(crate) fn tuned(configuration: &Configuration, tuning: &Tuning) -> Configuration {
    let mut tuned = configuration.clone();
    for finger in &mut tuned.fingers {
        for joint in &mut finger.joints {
            joint.servo.bandwidth_hz = tuning.bandwidth_hz;
            joint.servo.velocity_cutoff_hz = tuning.velocity_cutoff_hz;
        }
        for actuator in &mut finger.actuators {
            actuator.gains.kp = tuning.kp;
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
    /// The gain of the effort servos.
    pub(crate) kp: f64,
}

fn stroke<P: Plant>(
    rig: &mut Rig<P>,
    from: &OfJoints<f64>,
    to: &OfJoints<f64>,
    least_n: f64,
    errors: &mut Errors,
) -> Result<()> {
    // The positions of joints, and the commands of actuators, at rest.
    let mut positions = [[Range::default(); JOINTS]; FINGERS];
    let mut commands = [[Range::default(); ACTUATORS]; FINGERS];
    let ticks_per_master = rig.substeps();
    let per_s = f64::from(ticks_per_master) / rig.master_period_s();
    for tick in 0..rig.ticks_in(REST_S + WATCH_S) {
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
                let position = sensed.position[joint];
                let target = done.target[joint].ok_or("a joint has no set-point")?;
                errors.peak_deg = max(errors.peak_deg, (target - position).to_degrees().abs());
                if (now - SETTLED_S).abs() < 0.5 / per_s {
                    let error = (to[finger][joint] - position).to_degrees().abs();
                    errors.settled_deg = max(errors.settled_deg, error);
                }
                if now >= REST_S {
                    positions[finger][joint].include(position.to_degrees());
                }
            }
            if now >= REST_S {
                for (range, &command) in commands[finger].iter_mut().zip(&done.output.command) {
                    range.include(command);
                }
                let least = sensed.effort.iter().copied().fold(f64::MAX, min);
                errors.short_n = max(errors.short_n, least_n - least);
            }
        }
    }
    for range in positions.as_flattened() {
        errors.restless_deg = max(errors.restless_deg, range.width());
    }
    for range in commands.as_flattened() {
        errors.restless_n = max(errors.restless_n, range.width());
    }
    Ok(())
}

/// The set-points of all joints at a time after the beginning of a stroke.
fn points(from: &OfJoints<f64>, to: &OfJoints<f64>, time_s: f64) -> Result<OfJoints<SetPoint>> {
    let mut points = [[SetPoint::default(); JOINTS]; FINGERS];
    let ends = from.as_flattened().iter().zip(to.as_flattened());
    for (point, (&from, &to)) in points.as_flattened_mut().iter_mut().zip(ends) {
        *point = Polynomial::minimum_jerk(from, to, STROKE_S)?.at(min(time_s, STROKE_S));
    }
    Ok(points)
}

/// The range in which a value has been.
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
