use nalgebra::{SVector, Vector3};

use super::contacts::check;
use super::limits::fit;
use super::{Contacts, GraspError, GraspTuning, Quantity, TorqueExcess, Twist, Wrench};
use crate::kinematics::{Jacobian, Kinematics};
use crate::math::{Real, is_finite, real, sqrt};

/// Up to this angle (rad) the deviation of the object is the linear fit of the tips' motions, which is
/// the exact dual of the law of forces.
const LINEAR_RAD: f64 = 0.18;

/// From this angle on it is the exact rigid motion. In between one passes into the other: a step would
/// be a step of torque.
const RIGID_RAD: f64 = 0.2;

/// What one finger of a grasp measures, in the axes of the palm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerState<T: Real, const N: usize> {
    /// Where the tip is, m.
    pub tip: Vector3<T>,
    /// How it moves with the joints.
    pub jacobian: Jacobian<T, N>,
    /// How fast it moves, m/s.
    pub velocity: Vector3<T>,
    /// The torques that bear the finger's own weight, N m.
    pub gravity_torque: SVector<T, N>,
    /// The unit direction in which the joints move without moving the tip, if there is one.
    pub self_motion: Option<SVector<T, N>>,
    /// The positions of the joints, rad.
    pub q: SVector<T, N>,
    /// Their rates, rad/s.
    pub qd: SVector<T, N>,
}

impl<T: Real, const N: usize> FingerState<T, N> {
    /// The state of a finger at joint positions `q` (rad) that change at `qd` (rad/s).
    pub fn new(
        finger: &impl Kinematics<T, N>,
        q: &SVector<T, N>,
        qd: &SVector<T, N>,
        gravity_torque: &SVector<T, N>,
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

    /// Refuses what is no number; the tip is checked with the contacts.
    fn check(&self, finger: usize) -> Result<(), GraspError> {
        let none = SVector::zeros();
        let lists = [
            (Quantity::Jacobian, self.jacobian.as_slice()),
            (Quantity::TipMotion, self.velocity.as_slice()),
            (Quantity::GravityTorque, self.gravity_torque.as_slice()),
            (
                Quantity::SelfMotion,
                self.self_motion.as_ref().unwrap_or(&none).as_slice(),
            ),
            (Quantity::JointPosition, self.q.as_slice()),
            (Quantity::JointRate, self.qd.as_slice()),
        ];
        for (quantity, list) in lists {
            if let Some(value) = list.iter().find(|&&value| !is_finite(value)) {
                return Err(GraspError::NotFinite {
                    finger,
                    quantity,
                    value: value.to_f64(),
                });
            }
        }
        Ok(())
    }

    /// The torques by which the finger exerts a force on the object, N m.
    #[inline]
    fn torque(&self, force: &Vector3<T>) -> SVector<T, N> {
        let mut torque = SVector::<T, N>::zeros();
        let (columns, _) = self.jacobian.as_slice().as_chunks::<6>();
        for (torque, [x, y, z, ..]) in torque.iter_mut().zip(columns) {
            *torque = *x * force.x + *y * force.y + *z * force.z;
        }
        torque
    }
}

/// What one step of the law gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraspOutput<T: Real, const M: usize, const N: usize> {
    /// The torques of the joints of each finger, N m.
    pub torques: [SVector<T, N>; M],
    /// The motion that would take the object to where it is desired, at the centre.
    pub deviation: Twist<T>,
    /// The velocity of the object, at the centre.
    pub velocity: Twist<T>,
    /// Exerted on the object, about the centre.
    pub wrench: Wrench<T>,
    /// The forces of the fingers on the object that make the wrench, N.
    pub wrench_forces: [Vector3<T>; M],
    /// The whole forces of the fingers on the object, N: with the squeeze.
    pub forces: [Vector3<T>; M],
    /// How far each finger is from slipping, N; negative if it slips.
    pub margins: [T; M],
    /// The part of the squeeze that the limits of torque leave, 0 to 1.
    pub squeeze_share: T,
    /// The joint that leaves no more of the squeeze, with its torque at the whole squeeze.
    pub squeeze_limit: Option<TorqueExcess<T>>,
    /// The joint that is farthest beyond its limit without the squeeze that was taken away: the
    /// torques here exceed what it can have, and the wrench will not be what it says.
    pub overload: Option<TorqueExcess<T>>,
}

/// The law that gives a held object a stiffness: M >= 3 fingers of N joints each.
///
/// From the tips follow the displacement dx and the velocity v of the object, and from these the
/// wrench `w = K dx - D v + w_ff`, the forces of the fingers that make it, and the torques
/// `Jᵀ f + g` of their joints (Salisbury and Craig, "Articulated hands: force control and kinematic
/// issues", 1982). A torque that keeps the posture is added along the self-motion of each finger alone,
/// where it loads no contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraspStiffness<T: Real, const M: usize, const N: usize> {
    tuning: GraspTuning<T, M, N>,
    desired: [Vector3<T>; M],
    posture: [SVector<T, N>; M],
    present: [SVector<T, N>; M],
}

impl<T: Real, const M: usize, const N: usize> GraspStiffness<T, M, N> {
    /// Holds the object where it is: present tips and joints become the desired ones.
    ///
    /// # Errors
    ///
    /// [`TooFewContacts`](GraspError::TooFewContacts) below three fingers, those of
    /// [`Contacts::new`], and those of [`set_tuning`](Self::set_tuning).
    pub fn engage(
        fingers: &[FingerState<T, N>; M],
        tuning: GraspTuning<T, M, N>,
    ) -> Result<Self, GraspError> {
        if M < 3 {
            let (contacts, least) = (M, 3);
            return Err(GraspError::TooFewContacts { contacts, least });
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
            present: posture,
        })
    }

    /// What is in force.
    #[must_use]
    pub fn tuning(&self) -> &GraspTuning<T, M, N> {
        &self.tuning
    }

    /// Changes it from the next update on.
    ///
    /// # Errors
    ///
    /// What is wrong with it; the former tuning stays in force.
    pub fn set_tuning(&mut self, tuning: GraspTuning<T, M, N>) -> Result<(), GraspError> {
        tuning.check()?;
        self.tuning = tuning;
        Ok(())
    }

    /// Where the tips are to be, m.
    #[must_use]
    pub fn desired(&self) -> &[Vector3<T>; M] {
        &self.desired
    }

    /// Moves the object: the tips are to be here (m).
    ///
    /// # Errors
    ///
    /// Those of [`Contacts::new`]; the former tips stay desired.
    pub fn set_desired(&mut self, tips: &[Vector3<T>; M]) -> Result<(), GraspError> {
        check(tips, Quantity::DesiredTip)?;
        Contacts::new(*tips)?;
        self.desired = *tips;
        Ok(())
    }

    /// The posture that the joints are drawn to as far as the tips leave them free, rad.
    ///
    /// # Errors
    ///
    /// [`NotFinite`](GraspError::NotFinite); the former posture stays.
    pub fn set_posture(&mut self, posture: &[SVector<T, N>; M]) -> Result<(), GraspError> {
        for (finger, joints) in posture.iter().enumerate() {
            if let Some(value) = joints.iter().find(|&&angle| !is_finite(angle)) {
                return Err(GraspError::NotFinite {
                    finger,
                    quantity: Quantity::JointPosition,
                    value: value.to_f64(),
                });
            }
        }
        self.posture = *posture;
        Ok(())
    }

    /// One step of the law, from what the fingers measure to torques.
    ///
    /// Where a joint cannot bear its torque, the squeeze is reduced, on all edges alike. The
    /// wrench never is: what then still exceeds a limit is named in the answer.
    ///
    /// # Errors
    ///
    /// [`NotFinite`](GraspError::NotFinite) and [`TooLarge`](GraspError::TooLarge); tips that have
    /// come to lie on a line or that determine no rotation. There are no torques then.
    pub fn update(
        &mut self,
        fingers: &[FingerState<T, N>; M],
    ) -> Result<GraspOutput<T, M, N>, GraspError> {
        for (finger, state) in fingers.iter().enumerate() {
            state.check(finger)?;
        }
        let tuning = &self.tuning;
        let contacts = Contacts::new(fingers.each_ref().map(|finger| finger.tip))?;
        let deviation = self.deviation(&contacts)?;
        let velocities = fingers.each_ref().map(|finger| finger.velocity);
        let velocity = contacts.object_motion(&velocities, &tuning.center)?;

        let spring = tuning.stiffness.times(&deviation);
        let damper = tuning.damping.times(&velocity);
        let wrench = Wrench {
            force: spring.force - damper.force + tuning.feed_forward.force,
            moment: spring.moment - damper.moment + tuning.feed_forward.moment,
        };
        let wrench_forces = contacts.forces(&wrench, &tuning.center)?.forces;
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
                let quantity = Quantity::Torque;
                return Err(GraspError::TooLarge { quantity });
            }
        }
        let normals = tuning.normals(&contacts, &deviation)?;
        let margins = tuning
            .friction
            .margins(&normals, &forces, &[T::zero(); M])?;
        self.present = fingers.each_ref().map(|finger| finger.q);
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

    /// Lets go of the law: the joints as they were at the last update (rad), where a servo of their
    /// positions takes over without a step.
    #[must_use]
    pub fn release(self) -> [SVector<T, N>; M] {
        self.present
    }

    /// The motion from the present contacts to the desired ones.
    fn deviation(&self, contacts: &Contacts<T, M>) -> Result<Twist<T>, GraspError> {
        let center = &self.tuning.center;
        let rigid = contacts.rigid_motion(&self.desired, center)?;
        let angle = sqrt(rigid.angular.norm_squared());
        let (from, to) = (real::<T>(LINEAR_RAD), real::<T>(RIGID_RAD));
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
    fn keep(&self, finger: &FingerState<T, N>, posture: &SVector<T, N>) -> SVector<T, N> {
        let Some(direction) = &finger.self_motion else {
            return SVector::zeros();
        };
        let gains = &self.tuning.posture;
        let wanted = (posture - finger.q) * gains.stiffness - finger.qd * gains.damping;
        direction * direction.dot(&wanted)
    }
}
