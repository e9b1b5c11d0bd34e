use nalgebra::{SVector, Vector3};

use super::contacts::{check, check_list};
use super::limits::fit;
use super::{
    Contacts, GraspError, GraspTuning, TorqueExcess, Twist, Wrench, quantity, too_few, too_large,
};
use crate::kinematics::{Jacobian, Kinematics};
use crate::math::{is_finite, sqrt};

/// Up to this angle (rad) the deviation of the object is the linear fit of the tips' motions, which is
/// the exact dual of the law of forces.
const LINEAR_RAD: f64 = 0.18;

/// From this angle on it is the exact rigid motion. In between one passes into the other: a step would
/// be a step of torque.
const RIGID_RAD: f64 = 0.2;

/// The measured state of one finger, as the grasp law needs it. Vectors are in the axes of the
/// palm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerState<const N: usize> {
    /// The position of the tip, m.
    pub tip: Vector3<f64>,
    /// The Jacobian of the tip.
    pub jacobian: Jacobian<N>,
    /// The velocity of the tip, m/s.
    pub velocity: Vector3<f64>,
    /// The torques that bear the finger's own weight, N m.
    pub gravity_torque: SVector<f64, N>,
    /// The unit direction in which the joints move without moving the tip, if there is one.
    pub self_motion: Option<SVector<f64, N>>,
    /// The positions of the joints, rad.
    pub q: SVector<f64, N>,
    /// The rates of the joints, rad/s.
    pub qd: SVector<f64, N>,
}

impl<const N: usize> FingerState<N> {
    /// Computes the state of a finger from its joint positions `q` (rad), joint rates `qd` (rad/s)
    /// and the torques `gravity_torque` (N m) that bear the finger's own weight.
    pub fn new(
        finger: &impl Kinematics<N>,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        gravity_torque: &SVector<f64, N>,
    ) -> Self {
        let (pose, jacobian) = finger.kinematics(q);
        Self {
            tip: pose.position,
            jacobian,
            velocity: jacobian.fixed_rows::<3>(0) * qd,
            gravity_torque: *gravity_torque,
            self_motion: finger.self_motion(q),
            q: *q,
            qd: *qd,
        }
    }

    /// Refuses numbers that are infinite or NaN; the tip is checked with the contacts.
    fn check(&self, finger: usize) -> Result<(), GraspError> {
        let none = SVector::zeros();
        let lists = [
            (quantity::JACOBIAN, self.jacobian.as_slice()),
            (quantity::TIP_MOTION, self.velocity.as_slice()),
            (quantity::GRAVITY_TORQUE, self.gravity_torque.as_slice()),
            (
                quantity::SELF_MOTION,
                self.self_motion.as_ref().unwrap_or(&none).as_slice(),
            ),
            (quantity::JOINT_POSITION, self.q.as_slice()),
            (quantity::JOINT_RATE, self.qd.as_slice()),
        ];
        for (quantity, list) in lists {
            check_list(finger, quantity, list)?;
        }
        Ok(())
    }

    /// The torques by which the finger exerts a force on the object, N m.
    #[inline]
    fn torque(&self, force: &Vector3<f64>) -> SVector<f64, N> {
        let mut torque = SVector::<f64, N>::zeros();
        let (columns, _) = self.jacobian.as_slice().as_chunks::<6>();
        for (torque, [x, y, z, ..]) in torque.iter_mut().zip(columns) {
            *torque = *x * force.x + *y * force.y + *z * force.z;
        }
        torque
    }
}

/// The result of one step of [`GraspStiffness`]: the joint torques to command, and how they came
/// about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraspOutput<const M: usize, const N: usize> {
    /// The torques of the joints of each finger, N m.
    pub torques: [SVector<f64, N>; M],
    /// The motion that would bring the object to its desired place, at the centre: m, rad.
    pub deviation: Twist,
    /// The velocity of the object, at its middle: m/s, rad/s.
    pub velocity: Twist,
    /// The wrench on the object, about its middle, which is the centre less the deviation.
    pub wrench: Wrench,
    /// The forces of the fingers on the object that produce the wrench, N.
    pub wrench_forces: [Vector3<f64>; M],
    /// The total forces of the fingers on the object, including the squeeze, N.
    pub forces: [Vector3<f64>; M],
    /// The distance of each finger from slipping, N; negative if it slips.
    pub margins: [f64; M],
    /// The fraction of the squeeze that the limits of torque permit, 0 to 1.
    pub squeeze_share: f64,
    /// The joint that limits the squeeze, with its torque at the full squeeze; `None` if the full
    /// squeeze is possible.
    pub squeeze_limit: Option<TorqueExcess>,
    /// The joint that exceeds its limit most, even without the part of the squeeze that was taken
    /// away; `None` if no joint does. If there is one, these torques are not possible, and the real
    /// wrench will differ from `wrench`.
    pub overload: Option<TorqueExcess>,
}

/// The control law by which M fingers (at least 3) of N joints each hold an object, as if it were fixed to its desired
/// place by springs and dampers.
///
/// The tips determine the displacement dx and the velocity v of the object. From these follow the wrench
/// `w = K dx - D v + w_ff`, the forces of the fingers that produce it, and the torques `Jᵀ f + g` of their joints
/// (Salisbury and Craig, "Articulated hands: force control and kinematic issues", 1982). The torque
/// `n nᵀ (k (q₀ - q) - d q̇)` keeps the posture q₀ in which the grasp began: n is the unit self-motion of the finger
/// (`J n = 0`), so that at rest this torque loads no contact and does not change the stiffness of the object (Liégeois,
/// "Automatic supervisory control of the configuration and behavior of multibody mechanisms", 1977; Khatib, "A unified
/// approach for motion and force control of robot manipulators", 1987).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraspStiffness<const M: usize, const N: usize> {
    tuning: GraspTuning<M, N>,
    desired: [Vector3<f64>; M],
    posture: [SVector<f64, N>; M],
}

impl<const M: usize, const N: usize> GraspStiffness<M, N> {
    /// Begins a grasp that holds the object where it is now: the present tips and joint positions
    /// of `fingers` become the desired ones.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for fewer than three fingers; otherwise an
    /// error of [`Contacts::new`] about the tips, or of [`set_tuning`](Self::set_tuning) about the
    /// tuning.
    pub fn engage(
        fingers: &[FingerState<N>; M],
        tuning: GraspTuning<M, N>,
    ) -> Result<Self, GraspError> {
        if M < 3 {
            return Err(too_few(M, 3.0));
        }
        tuning.check()?;
        for (finger, state) in fingers.iter().enumerate() {
            state.check(finger)?;
        }
        let tips = fingers.each_ref().map(|finger| finger.tip);
        Contacts::new(tips)?;
        let posture = fingers.each_ref().map(|finger| finger.q);
        Ok(Self {
            tuning,
            desired: tips,
            posture,
        })
    }

    /// Returns the present parameters of the grasp, such as stiffness and squeeze.
    #[must_use]
    pub fn tuning(&self) -> &GraspTuning<M, N> {
        &self.tuning
    }

    /// Replaces the parameters of the grasp, from the next [`update`](Self::update) on.
    ///
    /// # Errors
    /// [`GraspError`] for the first wrong value; the former tuning stays in force then.
    pub fn set_tuning(&mut self, tuning: GraspTuning<M, N>) -> Result<(), GraspError> {
        tuning.check()?;
        self.tuning = tuning;
        Ok(())
    }

    /// Returns the desired positions of the fingertips in the frame of the palm, m.
    #[must_use]
    pub fn desired(&self) -> &[Vector3<f64>; M] {
        &self.desired
    }

    /// Sets new desired positions of the fingertips (m, in the palm), to which the fingers move the
    /// object.
    ///
    /// # Errors
    /// An error of [`Contacts::new`] if the tips are not finite, are one point or lie on a line;
    /// the former positions stay desired then.
    pub fn set_desired(&mut self, tips: &[Vector3<f64>; M]) -> Result<(), GraspError> {
        check(tips, quantity::DESIRED_TIP)?;
        Contacts::new(*tips)?;
        self.desired = *tips;
        Ok(())
    }

    /// Runs one step of the law: takes the measured states of the fingers, and returns the joint
    /// torques to command.
    ///
    /// If a joint cannot bear its torque, the squeeze is reduced on all edges by the same factor.
    /// The wrench is never reduced: if a torque then still exceeds its limit, the result names the
    /// joint.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for wrong numbers, and if the tips have come to lie on a line or determine no
    /// rotation. There are no torques then.
    pub fn update(&self, fingers: &[FingerState<N>; M]) -> Result<GraspOutput<M, N>, GraspError> {
        for (finger, state) in fingers.iter().enumerate() {
            state.check(finger)?;
        }
        let tuning = &self.tuning;
        let contacts = Contacts::new(fingers.each_ref().map(|finger| finger.tip))?;
        let deviation = self.deviation(&contacts)?;
        // The present middle of the object. The force that bears its weight acts there: about another point
        // the weight would turn an object that has been pushed aside.
        let middle = tuning.center - deviation.linear;
        let velocities = fingers.each_ref().map(|finger| finger.velocity);
        let velocity = contacts.object_motion(&velocities, &middle)?;

        let spring = tuning.stiffness.times(&deviation);
        let damper = tuning.damping.times(&velocity);
        let wrench = Wrench {
            force: spring.force - damper.force + tuning.feed_forward.force,
            moment: spring.moment - damper.moment + tuning.feed_forward.moment,
        };
        let wrench_forces = contacts.forces(&wrench, &middle)?.forces;
        let squeeze = contacts.internal_forces(&tuning.squeeze)?;

        let mut torques = [SVector::zeros(); M];
        let mut squeezing = [SVector::zeros(); M];
        let loads = fingers.iter().zip(&wrench_forces).zip(&self.posture);
        for (torque, ((finger, force), posture)) in torques.iter_mut().zip(loads) {
            *torque = finger.torque(force) + finger.gravity_torque + self.keep(finger, posture);
        }
        for (torque, (finger, force)) in squeezing.iter_mut().zip(fingers.iter().zip(&squeeze)) {
            *torque = finger.torque(force);
        }
        let fit = fit(&torques, &squeezing, &tuning.limits);
        let mut forces = wrench_forces;
        for (force, press) in forces.iter_mut().zip(&squeeze) {
            *force += press * fit.share;
        }
        for (torque, squeezing) in torques.iter_mut().zip(&squeezing) {
            *torque += squeezing * fit.share;
            if torque.iter().any(|&torque| !is_finite(torque)) {
                return Err(too_large(quantity::TORQUE));
            }
        }
        let normals = tuning.normals(&contacts, &deviation)?;
        let margins = tuning.friction.margins(&normals, &forces)?;
        Ok(GraspOutput {
            torques,
            deviation,
            velocity,
            wrench,
            wrench_forces,
            forces,
            margins,
            squeeze_share: fit.share,
            squeeze_limit: fit.squeeze_limit,
            overload: fit.overload,
        })
    }

    /// The motion from the present contacts to the desired ones.
    fn deviation(&self, contacts: &Contacts<M>) -> Result<Twist, GraspError> {
        let center = &self.tuning.center;
        let rigid = contacts.rigid_motion(&self.desired, center)?;
        let angle = sqrt(rigid.angular.norm_squared());
        let (from, to) = (LINEAR_RAD, RIGID_RAD);
        if angle >= to {
            return Ok(rigid);
        }
        let mut motions = self.desired;
        for (motion, point) in motions.iter_mut().zip(contacts.points()) {
            *motion -= point;
        }
        let linear = contacts.object_motion(&motions, center)?;
        if angle <= from {
            return Ok(linear);
        }
        let part = (angle - from) / (to - from);
        Ok(Twist {
            linear: linear.linear + (rigid.linear - linear.linear) * part,
            angular: linear.angular + (rigid.angular - linear.angular) * part,
        })
    }

    /// The torque that keeps the posture of a finger, along its self-motion.
    fn keep(&self, finger: &FingerState<N>, posture: &SVector<f64, N>) -> SVector<f64, N> {
        let Some(direction) = &finger.self_motion else {
            return SVector::zeros();
        };
        let gains = &self.tuning.posture;
        let wanted = (posture - finger.q) * gains.stiffness - finger.qd * gains.damping;
        direction * direction.dot(&wanted)
    }
}
