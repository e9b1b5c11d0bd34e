//! The joints that take a tip along a path in space.

mod error;

use core::ops::Range;

pub use error::{JointPathError, PathDeviation};
use heapless::Vec;
use nalgebra::SVector;

use super::path::KNOTS;
use super::{
    CartesianPath, MotionError, Pace, Primitive, Profile, ProfileLimits, Spline, Target, Via,
};
use crate::kinematics::{Kinematics, PoseSearch, Reach, Side};
use crate::math::{abs, max, min, sqrt};
use crate::number::{NumberError, Requirement, check_motion, is_within, not_negative};
use crate::pose::rotation_vector;
use crate::{Pose, Subject};

/// The intervals of a path, between its ends and as many via points as a [`Primitive`] can have.
const INTERVALS: u16 = KNOTS as u16 - 1;
/// Postures that are searched for in each interval, so that none is far from the one before it.
const SEARCHES: u16 = 4;
/// The number of times that the way from one of them to the next is halved before the path counts as impossible.
const HALVINGS: u32 = 4;
/// Points of each interval at which the tip is compared with the path.
const SAMPLES: u16 = 8;
/// The largest change of a joint from one posture to the next, rad or m: a larger one is a jump to another branch, or
/// the way past a singular posture.
const JUMP: f64 = 0.5;

/// The postures of N joints that take the tip of a mechanism along a [`CartesianPath`], from rest to rest, on one
/// continuous branch within the limits. Make it a [`Primitive`], which a [`Generator`](super::Generator) runs within the
/// limits of velocity and acceleration.
///
/// The tip begins and ends smoothly: after the share `t` of the duration it has gone `3 t² - 2 t³` of the path. The
/// joints follow the cubic spline through 18 postures, evenly distributed in time.
///
/// ```
/// use condor_hand::Pose;
/// use condor_hand::kinematics::{
///     Chain, ChainBody, ChainJoint, ChainMotion, JointLimits, Kinematics, PoseSearch,
/// };
/// use condor_hand::trajectory::{CartesianPath, JointPath, Pace, PathDeviation};
/// use nalgebra::{SVector, Vector3};
///
/// // Rolls and pitches in turn: shoulder, elbow and wrist.
/// let (roll, pitch) = (Vector3::z(), Vector3::y());
/// let joints = [(0.3, roll), (0.0, pitch), (0.2, roll), (0.2, pitch), (0.2, roll), (0.2, pitch), (0.1, roll)];
/// let joints = joints.map(|(height, axis)| {
///     ChainJoint::new(Pose::at(0.0, 0.0, height), ChainMotion::Revolute(axis))
/// });
/// let arm = Chain::new(Pose::identity(), joints, [ChainBody::massless(); 7], Vector3::zeros())?;
/// let search = PoseSearch::new(JointLimits::new(SVector::repeat(-2.5), SVector::repeat(2.5))?);
///
/// let present = SVector::from([0.0, 0.3, 0.0, 1.2, 0.0, 0.8, 0.0]);
/// let start = arm.tip(&present);
/// let mut end = start;
/// end.position.y += 0.2;
/// let line = CartesianPath::line(&start, &end)?;
/// let allowed = PathDeviation { position: 1e-4, rotation: 1e-3 };
/// let joints = JointPath::along(&line, &arm, &search, &present, &allowed)?;
/// // At the highest speed that the limits of a generator permit, by the joints 0 to 6.
/// let primitive = joints.primitive::<7>(0..7, Pace::Speed(1.0))?;
/// assert!(joints.deviation().position <= 1e-4 && primitive.mask == 0b111_1111);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct JointPath<const N: usize> {
    knots: Vec<SVector<f64, N>, KNOTS>,
    deviation: PathDeviation,
}

impl<const N: usize> JointPath<N> {
    /// Searches for the joints that take the tip of `mechanism` along `path`, from the posture `start`, in rad (m for a
    /// prismatic joint), which must be at the beginning of the path.
    ///
    /// `search` has the limits, the accuracy, and the posture that a redundant mechanism prefers: that of the start if it
    /// names none. Its restarts are not used, since they would leave the branch. The tip is compared with the path at 8
    /// points between each two postures, and may be off by `allowed`. If the accuracy of the rotation is π or more, any
    /// orientation will do: the tip follows the path with its position alone, and no deviation has an angle.
    ///
    /// # Errors
    /// [`JointPathError::OutOfReach`] or [`Limit`](JointPathError::Limit) if no posture of the branch brings the tip to
    /// the path, or the joints would pass a limit between two postures; [`Jump`](JointPathError::Jump) if they leave the
    /// branch; [`Deviation`](JointPathError::Deviation) if the tip would be further off the path than `allowed`, also at
    /// its beginning; and [`Number`](JointPathError::Number) if a number is not finite or `start` is not within the limits.
    pub fn along<M: Kinematics<N>>(
        path: &CartesianPath,
        mechanism: &M,
        search: &PoseSearch<N>,
        start: &SVector<f64, N>,
        allowed: &PathDeviation,
    ) -> Result<Self, JointPathError> {
        not_negative("the distance that is permitted, m,", allowed.position)?;
        not_negative("the angle that is permitted, rad,", allowed.rotation)?;
        check_start(search, start)?;
        let off = deviation(search, &mechanism.tip(start), &path.at(0.0));
        if !is_allowed(&off, allowed) {
            return Err(JointPathError::Deviation { fraction: 0.0, off });
        }
        let search = PoseSearch {
            preferred: search.preferred.or(Some(*start)),
            restarts: 0,
            ..*search
        };
        let mut knots = Vec::new();
        // As many as there is room for, here and below.
        let _ = knots.push(*start);
        let (mut q, mut before) = (*start, 0.0);
        for (number, share) in shares(SEARCHES).skip(1) {
            q = follow(path, mechanism, &search, q, (before, share))?;
            before = share;
            if number % SEARCHES == 0 {
                let _ = knots.push(q);
            }
        }
        let mut joints = Self {
            knots,
            deviation: PathDeviation::default(),
        };
        let splines = joints.splines()?;
        check_ranges(&search, &splines)?;
        joints.deviation = compare(path, mechanism, &search, &splines, allowed)?;
        Ok(joints)
    }

    /// Iterates over the postures of the path with their times as shares of its duration, from 0 to 1; positions in rad
    /// (m for a prismatic joint).
    pub fn postures(&self) -> impl Iterator<Item = (f64, &SVector<f64, N>)> {
        shares(1).map(|(_, share)| share).zip(&self.knots)
    }

    /// Returns the greatest deviation of the tip from the path at the points where they were compared.
    #[must_use]
    pub fn deviation(&self) -> PathDeviation {
        self.deviation
    }

    /// Returns the shortest duration, s, with which all joints keep their limits of velocity and acceleration. That of a
    /// motion should be a multiple of the tick, so that it does not end within one.
    ///
    /// # Errors
    /// [`NumberError`] if a limit is not possible.
    pub fn least_duration(&self, limits: &[ProfileLimits; N]) -> Result<f64, NumberError> {
        let mut duration = 0.0;
        for (joint, (spline, limits)) in self.splines()?.iter().zip(limits).enumerate() {
            limits.validate(joint)?;
            // Velocity goes with 1 / duration, acceleration with its square.
            let peaks = spline.peaks();
            duration = max(duration, peaks.velocity / limits.velocity);
            duration = max(duration, sqrt(peaks.acceleration / limits.acceleration));
        }
        Ok(duration)
    }

    /// Returns the motion of the joints with the numbers `joints`, of J, along the path: the first joint of the mechanism
    /// is that of the first number. It must start at rest in the first posture of the path. If there are fewer numbers
    /// than N, the last joints of the mechanism are left out, such as those that a finger of a configuration does not have.
    ///
    /// With [`Pace::Speed`] the [`Generator`](super::Generator) chooses the shortest duration with which all joints keep
    /// that share of their velocities, and their accelerations. The tip keeps to the path also while the motion stops.
    ///
    /// # Errors
    /// [`MotionError::NoJoint`] if a joint does not exist.
    pub fn primitive<const J: usize>(
        &self,
        joints: Range<usize>,
        pace: Pace,
    ) -> Result<Primitive<J>, MotionError> {
        let mut primitive = Primitive::new(pace, Profile::Cubic);
        if let Some(last) = self.knots.last() {
            for (joint, &position) in joints.clone().zip(last) {
                primitive = primitive.with(joint, Target::Absolute(position))?;
            }
        }
        let inner = self.postures().skip(1).take(KNOTS - 2);
        for (at, posture) in inner {
            let mut positions = [0.0; J];
            for (joint, &position) in joints.clone().zip(posture) {
                if let Some(place) = positions.get_mut(joint) {
                    *place = position;
                }
            }
            let _ = primitive.vias.push(Via { at, positions });
        }
        Ok(primitive)
    }

    /// The spline of each joint, over a duration of 1 s, as the motion has it.
    fn splines(&self) -> Result<Vec<Spline<KNOTS>, N>, NumberError> {
        let mut splines = Vec::new();
        for joint in 0..N {
            let (mut times, mut positions) = (Vec::<f64, KNOTS>::new(), Vec::<f64, KNOTS>::new());
            for (share, posture) in self.postures() {
                if let Some(&position) = posture.get(joint) {
                    let _ = (times.push(share), positions.push(position));
                }
            }
            let spline = Spline::clamped(&times, &positions, (0.0, 0.0))
                .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
            let _ = splines.push(spline);
        }
        Ok(splines)
    }
}

/// The share of a path that the tip has gone after the share `t` of the duration.
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// The numbers and the shares of the duration of `of_each` points in each interval, with both ends.
fn shares(of_each: u16) -> impl Iterator<Item = (u16, f64)> {
    let all = INTERVALS * of_each;
    (0..=all).map(move |number| (number, f64::from(number) / f64::from(all)))
}

fn check_start<const N: usize>(
    search: &PoseSearch<N>,
    start: &SVector<f64, N>,
) -> Result<(), NumberError> {
    let limits = search.limits.lower().iter().zip(search.limits.upper());
    for (joint, (&position, (&low, &high))) in start.iter().zip(limits).enumerate() {
        let within = Requirement::Within(low, high);
        check_motion(
            "the position at the start, rad or m,",
            position,
            within,
            high - low,
        )
        .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
    }
    Ok(())
}

/// Follows a path from the posture `q` at one share of the duration to another share; in shorter steps where a step fails.
fn follow<M: Kinematics<N>, const N: usize>(
    path: &CartesianPath,
    mechanism: &M,
    search: &PoseSearch<N>,
    mut q: SVector<f64, N>,
    (mut at, end): (f64, f64),
) -> Result<SVector<f64, N>, JointPathError> {
    let (mut step, mut halvings) = (end - at, 0);
    while at < end {
        let next = min(at + step, end);
        let fraction = smooth(next);
        let found = search.run(mechanism, &path.at(fraction), &q)?;
        match check_step(&found, &q, fraction) {
            Ok(()) => (q, at) = (found.posture, next),
            Err(error) if halvings >= HALVINGS => return Err(error),
            Err(_) => {
                step *= 0.5;
                halvings += 1;
            }
        }
    }
    Ok(q)
}

/// Checks that a search has ended at the path, and near to the posture `before`.
fn check_step<const N: usize>(
    found: &Reach<N>,
    before: &SVector<f64, N>,
    fraction: f64,
) -> Result<(), JointPathError> {
    let off = PathDeviation {
        position: found.position,
        rotation: found.rotation,
    };
    if !found.is_reached {
        let mut held = found.held.iter().enumerate();
        return Err(
            match held.find_map(|(joint, side)| Some((joint, (*side)?))) {
                Some((joint, side)) => JointPathError::Limit {
                    fraction,
                    joint,
                    side,
                    off,
                },
                None => JointPathError::OutOfReach { fraction, off },
            },
        );
    }
    let (mut joint, mut by) = (0, 0.0);
    for (number, (&to, &from)) in found.posture.iter().zip(before.iter()).enumerate() {
        if abs(to - from) > by {
            (joint, by) = (number, abs(to - from));
        }
    }
    if by > JUMP {
        return Err(JointPathError::Jump {
            fraction,
            joint,
            by,
        });
    }
    Ok(())
}

/// Checks that no joint passes its limits between two postures.
fn check_ranges<const N: usize>(
    search: &PoseSearch<N>,
    splines: &[Spline<KNOTS>],
) -> Result<(), JointPathError> {
    let limits = search.limits.lower().iter().zip(search.limits.upper());
    for (joint, (spline, (&low, &high))) in splines.iter().zip(limits).enumerate() {
        let peaks = spline.peaks();
        if is_within(peaks.low, low, high) && is_within(peaks.high, low, high) {
            continue;
        }
        let side = if is_within(peaks.low, low, high) {
            Side::High
        } else {
            Side::Low
        };
        let (mut fraction, mut furthest) = (0.0, f64::NEG_INFINITY);
        for (_, share) in shares(SAMPLES) {
            let position = spline.at(share).position;
            let beyond = match side {
                Side::Low => low - position,
                Side::High => position - high,
            };
            if beyond > furthest {
                (fraction, furthest) = (smooth(share), beyond);
            }
        }
        let off = PathDeviation::default();
        return Err(JointPathError::Limit {
            fraction,
            joint,
            side,
            off,
        });
    }
    Ok(())
}

fn deviation<const N: usize>(search: &PoseSearch<N>, tip: &Pose, target: &Pose) -> PathDeviation {
    let turn = rotation_vector(&(target.rotation * tip.rotation.transpose()));
    PathDeviation {
        position: sqrt((target.position - tip.position).norm_squared()),
        rotation: if search.is_any_orientation() {
            0.0
        } else {
            sqrt(turn.norm_squared())
        },
    }
}

fn is_allowed(off: &PathDeviation, allowed: &PathDeviation) -> bool {
    off.position <= allowed.position && off.rotation <= allowed.rotation
}

/// The greatest deviation of the tip, if it is as small as permitted.
fn compare<M: Kinematics<N>, const N: usize>(
    path: &CartesianPath,
    mechanism: &M,
    search: &PoseSearch<N>,
    splines: &[Spline<KNOTS>],
    allowed: &PathDeviation,
) -> Result<PathDeviation, JointPathError> {
    let mut greatest = PathDeviation::default();
    let mut refused: Option<(f64, PathDeviation)> = None;
    for (_, share) in shares(SAMPLES) {
        let mut q = SVector::<f64, N>::zeros();
        for (place, spline) in q.iter_mut().zip(splines) {
            *place = spline.at(share).position;
        }
        let fraction = smooth(share);
        let (tip, target) = (mechanism.tip(&q), path.at(fraction));
        let off = deviation(search, &tip, &target);
        let worst = refused.map_or(0.0, |(_, off)| off.position);
        if !is_allowed(&off, allowed) && (refused.is_none() || off.position > worst) {
            refused = Some((fraction, off));
        }
        greatest.position = max(greatest.position, off.position);
        greatest.rotation = max(greatest.rotation, off.rotation);
    }
    match refused {
        Some((fraction, off)) => Err(JointPathError::Deviation { fraction, off }),
        None => Ok(greatest),
    }
}
