//! The joints of any mechanism that bring its tip to a pose: inverse kinematics.

use nalgebra::SVector;

use super::descent::{Goal, Place};
use super::{JointLimits, Kinematics, Side, check};
use crate::math::{max, sqrt};
use crate::number::{NumberError, finite, positive};
use crate::{Pose, Subject};

/// The largest change of a joint in one step of a search, rad or m.
const STRIDE: f64 = 0.5;
/// The moves along the null space that bring the joints to the preferred posture.
const MOVES: u32 = 20;

/// A search for the posture that brings the tip of a mechanism to a pose, in position and orientation, within the limits
/// of the joints. Make one with [`new`](Self::new), change its fields where needed, and call [`run`](Self::run).
///
/// The search goes downhill from the present posture. Where that ends away from the target, other attempts begin at
/// postures spread evenly within the limits, always the same ones in the same order; so the same input has the same
/// result. The mechanism may have any number of joints. If there are more than the pose needs, those that reach it come
/// as near to a preferred posture as they can.
///
/// ```
/// use condor_hand::Pose;
/// use condor_hand::kinematics::{
///     Chain, ChainBody, ChainJoint, ChainMotion, JointLimits, Kinematics, PoseSearch,
/// };
/// use nalgebra::{SVector, Vector3};
///
/// // Rolls and pitches in turn: shoulder, elbow and wrist.
/// let (roll, pitch) = (Vector3::z(), Vector3::y());
/// let joints = [(0.3, roll), (0.0, pitch), (0.2, roll), (0.2, pitch), (0.2, roll), (0.2, pitch), (0.1, roll)];
/// let joints = joints.map(|(height, axis)| {
///     ChainJoint::new(Pose::at(0.0, 0.0, height), ChainMotion::Revolute(axis))
/// });
/// let arm = Chain::new(Pose::identity(), joints, [ChainBody::massless(); 7], Vector3::zeros())?;
/// let limits = JointLimits::new(SVector::repeat(-2.5), SVector::repeat(2.5))?;
///
/// let present = SVector::from([0.0, 0.3, 0.0, 1.2, 0.0, 0.8, 0.0]);
/// let mut target = arm.tip(&present);
/// target.position.z += 0.05;
/// let found = PoseSearch::new(limits).run(&arm, &target, &present)?;
/// assert!(found.is_reached && found.restarts == 0);
/// assert!((arm.tip(&found.posture).position - target.position).norm() <= 1e-9);
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSearch<const N: usize> {
    /// The limits within which all postures of the search stay.
    pub limits: JointLimits<N>,
    /// The posture to which the joints of a redundant mechanism come as near as the target permits, rad (m for a
    /// prismatic joint); `None` for the present one.
    pub preferred: Option<SVector<f64, N>>,
    /// The distance from the target at which a tip has reached it, m; 1e-9 from [`new`](Self::new).
    pub position: f64,
    /// The angle from the target at which a tip has reached it, rad; 1e-9 from [`new`](Self::new). No angle is above π,
    /// so with π or more any orientation will do: only the position counts.
    pub rotation: f64,
    /// The greatest number of attempts after the first one, 64 from [`new`](Self::new). With 0 the result is on the
    /// same branch as the present posture.
    pub restarts: u32,
    /// The greatest number of steps of one attempt, 100 from [`new`](Self::new).
    pub steps: u32,
}

/// The result of a [`PoseSearch`]: a posture, and the error that remains there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach<const N: usize> {
    /// The posture, within the limits, rad (m for a prismatic joint).
    pub posture: SVector<f64, N>,
    /// Whether the tip has reached the target there.
    pub is_reached: bool,
    /// The distance of the tip from the target, m.
    pub position: f64,
    /// The angle of the rotation from the tip to the target, rad; 0 if any orientation will do.
    pub rotation: f64,
    /// The joints that would bring the tip nearer to a target that is not reached if their limits were wider, with the
    /// side of the limit.
    pub held: [Option<Side>; N],
    /// The number of attempts after the first one.
    pub restarts: u32,
    /// The steps of all attempts together, and of the moves to the preferred posture.
    pub steps: u32,
}

impl<const N: usize> PoseSearch<N> {
    /// Makes a search within `limits` that prefers the present posture, with an accuracy of 1e-9 m and rad, 64 restarts,
    /// and 100 steps for each attempt.
    #[must_use]
    pub fn new(limits: JointLimits<N>) -> Self {
        Self {
            limits,
            preferred: None,
            position: 1e-9,
            rotation: 1e-9,
            restarts: 64,
            steps: 100,
        }
    }

    /// Searches for the posture of `mechanism` that brings its tip to `target`, a pose in the palm, from the posture
    /// `present`, rad (m for a prismatic joint).
    ///
    /// If no attempt reaches the target, the result is that of the attempt which ends nearest to it. There a rotation by
    /// one rad counts as much as the distance by which such a rotation of the joints moves the tip on average.
    ///
    /// Each step is one of Newton's on half the square of that distance, damped where it does not go downhill
    /// (Levenberg, "A method for the solution of certain non-linear problems in least squares", 1944; Nakamura and
    /// Hanafusa, "Inverse kinematic solutions with singularity robustness for robot manipulator control", 1986). Joints
    /// that a limit holds are left out. Other attempts begin at the points of an additive recurrence with the powers of
    /// a generalized golden ratio (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
    ///
    /// All attempts take at most `(restarts + 1) steps` steps, and the moves to the preferred posture at most 100 more.
    ///
    /// # Errors
    /// [`NumberError`] if a number of the target or of a posture is not finite, the rotation of the target is not
    /// orthonormal and right-handed up to 1e-9, or an accuracy is not above zero.
    pub fn run<M: Kinematics<N>>(
        &self,
        mechanism: &M,
        target: &Pose,
        present: &SVector<f64, N>,
    ) -> Result<Reach<N>, NumberError> {
        check::pose(Subject::Tip, target)?;
        let preferred = self.preferred.unwrap_or(*present);
        for (joint, (&start, &end)) in present.iter().zip(preferred.iter()).enumerate() {
            finite("the present position, rad or m,", start)
                .and_then(|()| finite("the preferred position, rad or m,", end))
                .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
        }
        positive("the accuracy of the position, m,", self.position)?;
        positive("the accuracy of the rotation, rad,", self.rotation)?;

        let length = self.length(mechanism);
        let goal = Goal {
            mechanism,
            limits: &self.limits,
            target: *target,
            size: length,
            length: if self.is_any_orientation() {
                0.0
            } else {
                length
            },
            stride: STRIDE,
            enough: (self.position, self.rotation),
        };
        let (mut best, mut steps) = goal.descend(self.limits.clamp(present), self.steps);
        let mut restarts = 0;
        if !goal.is_reached(&best) {
            let (place, again, more) = self.restart(&goal, best);
            (best, restarts, steps) = (place, again, more.saturating_add(steps));
        }
        if goal.is_reached(&best) {
            let (place, more) = goal.settle(best, &self.limits.clamp(&preferred), MOVES);
            (best, steps) = (place, more.saturating_add(steps));
        }
        Ok(Reach::of(&goal, &best, restarts, steps))
    }

    /// Whether only the position of the tip counts.
    pub(crate) fn is_any_orientation(&self) -> bool {
        self.rotation >= core::f64::consts::PI
    }

    /// Begins again until an attempt reaches the goal. Returns the place that is nearest to it, the number of attempts
    /// and their steps.
    fn restart<M: Kinematics<N>>(
        &self,
        goal: &Goal<'_, M, N>,
        mut best: Place<N>,
    ) -> (Place<N>, u32, u32) {
        let mut starts = Starts::new();
        let mut steps = 0_u32;
        for restart in 1..=self.restarts {
            let (place, more) = goal.descend(starts.next(&self.limits), self.steps);
            steps = more.saturating_add(steps);
            if goal.is_reached(&place) {
                return (place, restart, steps);
            }
            if goal.square(&place) < goal.square(&best) {
                best = place;
            }
        }
        (best, self.restarts, steps)
    }

    /// The distance by which a rotation of the joints by one rad moves the tip, in the mean over all of them in the
    /// middle of their limits, m; one if no joint moves it.
    fn length<M: Kinematics<N>>(&self, mechanism: &M) -> f64 {
        let (_, jacobian) = mechanism.kinematics(&self.limits.middle());
        let linear = jacobian.fixed_rows::<3>(0).norm_squared();
        let angular = jacobian.fixed_rows::<3>(3).norm_squared();
        let length = sqrt(linear / max(angular, 1.0));
        if length > 0.0 { length } else { 1.0 }
    }
}

impl<const N: usize> Reach<N> {
    fn of<M: Kinematics<N>>(
        goal: &Goal<'_, M, N>,
        place: &Place<N>,
        restarts: u32,
        steps: u32,
    ) -> Self {
        let is_reached = goal.is_reached(place);
        Self {
            posture: place.q,
            is_reached,
            position: sqrt(place.shift.norm_squared()),
            rotation: sqrt(place.turn.norm_squared()),
            held: if is_reached {
                [None; N]
            } else {
                goal.held(place)
            },
            restarts,
            steps,
        }
    }
}

/// The postures at which attempts begin.
struct Starts<const N: usize> {
    /// The place of each joint in its range, from 0 to 1.
    shares: SVector<f64, N>,
    step: SVector<f64, N>,
}

impl<const N: usize> Starts<N> {
    /// Newton's steps to the root: it is between 1 and 2, and the function is convex there.
    const STEPS: u32 = 40;

    fn new() -> Self {
        // The root of `x^(N+1) = x + 1`, from above.
        let mut root = 2.0;
        for _ in 0..Self::STEPS {
            let power = (0..N).fold(1.0, |power, _| power * root);
            let slope = f64::from(N as u32 + 1) * power - 1.0;
            root -= (power * root - root - 1.0) / max(slope, 1.0);
        }
        let mut share = 1.0;
        let step = SVector::from_fn(|_, _| {
            share /= root;
            share
        });
        Self {
            shares: SVector::repeat(0.5),
            step,
        }
    }

    fn next(&mut self, limits: &JointLimits<N>) -> SVector<f64, N> {
        self.shares += self.step;
        for share in &mut self.shares {
            if *share >= 1.0 {
                *share -= 1.0;
            }
        }
        let range = limits.upper() - limits.lower();
        limits.clamp(&(limits.lower() + range.component_mul(&self.shares)))
    }
}
