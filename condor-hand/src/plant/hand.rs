use nalgebra::{SVector, Vector3};

use super::check::all_finite;
use super::contact::{SimContact, SimSurface};
use super::finger::SimFinger;
use super::object::SimObject;
use super::table::SimTable;
use crate::dynamics::Dynamics;
use crate::grasp::Wrench;
use crate::kinematics::Kinematics;
use crate::number::{NumberError, Requirement, Subject, count, not_negative, positive};
use crate::transmission::Transmission;

/// The parameters of a [`SimHand`], except for its fingers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandParameters {
    /// The time for which a command is constant, s.
    pub period_s: f64,
    /// The number of equal updates in that time.
    pub updates: u32,
    /// Gravity in the axes of the palm, m/s².
    pub gravity: Vector3<f64>,
    /// The radius of the sphere about each tip that can touch things, m; zero for a point.
    pub tip_radius: f64,
    /// The surface between a tip and the object.
    pub tip_object: SimSurface,
}

/// A simulated hand of F fingers of N joints. Optionally it has an object that the fingertips can
/// touch, and a table that carries the palm.
#[derive(Clone, Debug)]
pub struct SimHand<M, T, const F: usize, const N: usize, const A: usize> {
    parameters: HandParameters,
    fingers: [SimFinger<M, T, N, A>; F],
    tips: [Tip; F],
    object: Option<SimObject>,
    disturbance: Wrench,
    table: Option<SimTable>,
    table_forces: Vector3<f64>,
    steps: u64,
}

/// The contact of a tip, and the forces that push it besides.
#[derive(Clone, Copy, Debug)]
struct Tip {
    object: SimContact,
    disturbance: Wrench,
}

impl<M, T, const F: usize, const N: usize, const A: usize> SimHand<M, T, F, N, A>
where
    M: Kinematics<N> + Dynamics<N>,
    T: Transmission<N, A>,
{
    /// Makes a hand without an object, on a palm that does not move.
    ///
    /// # Errors
    /// [`NumberError`] for the first parameter that is wrong.
    pub fn new(
        fingers: [SimFinger<M, T, N, A>; F],
        parameters: HandParameters,
    ) -> Result<Self, NumberError> {
        positive("the time of a step, s", parameters.period_s)?;
        positive("the updates in a step", f64::from(parameters.updates))?;
        all_finite("gravity, m/s²", parameters.gravity.iter())?;
        not_negative("the radius of a tip, m", parameters.tip_radius)?;
        parameters.tip_object.check()?;
        let tip = Tip {
            object: SimContact::none(),
            disturbance: Wrench::zero(),
        };
        Ok(Self {
            parameters,
            fingers,
            tips: [tip; F],
            object: None,
            disturbance: Wrench::zero(),
            table: None,
            table_forces: Vector3::zeros(),
            steps: 0,
        })
    }

    /// Returns the hand with an object, which the fingertips can touch.
    #[must_use]
    pub fn with_object(mut self, object: SimObject) -> Self {
        self.object = Some(object);
        self
    }

    /// Returns the hand with its palm on a table, which [`drive_table`](Self::drive_table) moves.
    #[must_use]
    pub fn with_table(mut self, table: SimTable) -> Self {
        self.table = Some(table);
        self
    }

    /// Simulates one period of [`HandParameters::period_s`]. `commands` (N, or N m) are the constant
    /// commands of the actuators of all fingers; a NaN counts as zero.
    ///
    /// # Errors
    /// [`NumberError`] if a new state would not be finite, or a mass matrix is not positive
    /// definite. A part that could not move keeps its state, so every state is finite; the parts of
    /// the hand may then be some updates apart.
    pub fn step(&mut self, commands: &[[f64; A]; F]) -> Result<(), NumberError> {
        let dt = self.parameters.period_s / f64::from(self.parameters.updates);
        for _ in 0..self.parameters.updates {
            self.advance(dt, commands)?;
        }
        self.steps += 1;
        Ok(())
    }

    fn advance(&mut self, dt: f64, commands: &[[f64; A]; F]) -> Result<(), NumberError> {
        let mut gravity = self.parameters.gravity;
        if let Some(table) = &mut self.table {
            table.advance(dt, &self.table_forces)?;
            gravity -= table.acceleration();
        }
        let mut on_object = self.disturbance;
        for ((finger, tip), commands) in self.fingers.iter_mut().zip(&mut self.tips).zip(commands) {
            if self.object.is_none() && tip.disturbance == Wrench::zero() {
                finger.advance(dt, commands, &gravity, &SVector::zeros())?;
                continue;
            }
            let (pose, jacobian) = finger.mechanism().kinematics(finger.q());
            let twist = jacobian * finger.qd();
            let velocity = twist.fixed_rows::<3>(0).into_owned();
            let turning = twist.fixed_rows::<3>(3).into_owned();
            let velocity_at =
                |point: &Vector3<f64>| velocity + turning.cross(&(point - pose.position));
            let mut wrench = tip.disturbance;
            if let Some(object) = &self.object {
                let overlap = object.overlap(&pose.position, self.parameters.tip_radius);
                let sliding = velocity_at(&overlap.point) - object.velocity_at(&overlap.point);
                let surface = &self.parameters.tip_object;
                let force = tip.object.update(surface, &overlap, &sliding, dt);
                wrench.add_force(&force, &(overlap.point - pose.position));
                on_object.add_force(&-force, &(overlap.point - object.pose().position));
            }
            let torque = jacobian.fixed_rows::<3>(0).tr_mul(&wrench.force)
                + jacobian.fixed_rows::<3>(3).tr_mul(&wrench.moment);
            finger.advance(dt, commands, &gravity, &torque)?;
        }
        if let Some(object) = &mut self.object {
            object.advance(dt, &on_object, &gravity)?;
        }
        Ok(())
    }

    /// Removes the object, or replaces it by `object`, which nothing touches yet.
    pub fn put_object(&mut self, object: Option<SimObject>) {
        self.object = object;
        for tip in &mut self.tips {
            tip.object = SimContact::none();
        }
    }

    /// Pushes the object with a wrench (N, N m), whose moment is about its centre. The push lasts
    /// until the next call; pass a zero wrench to end it.
    ///
    /// # Errors
    /// [`NumberError`] if the wrench is not finite; the old one stays then.
    pub fn push_object(&mut self, wrench: Wrench) -> Result<(), NumberError> {
        check(&wrench)?;
        self.disturbance = wrench;
        Ok(())
    }

    /// Pushes the tip of finger number `finger` (from 0) with a wrench (N, N m), whose moment is
    /// about the tip. The push lasts until the next call for that finger.
    ///
    /// # Errors
    /// [`NumberError`] if the wrench is not finite, or the finger does not exist; the old one stays
    /// then.
    pub fn push_tip(&mut self, finger: usize, wrench: Wrench) -> Result<(), NumberError> {
        check(&wrench)?;
        let tip = self.tips.get_mut(finger).ok_or(NumberError {
            at: Subject::Whole,
            what: "the number of the finger, from 0,",
            value: count(finger),
            must: Requirement::Below(count(F)),
        })?;
        tip.disturbance = wrench;
        Ok(())
    }

    /// Sets the forces of the table's motors (N, along x, y and z of the palm), which act until the
    /// next call. Without a table they have no effect.
    ///
    /// # Errors
    /// [`NumberError`] if a force is not finite; the old ones stay then.
    pub fn drive_table(&mut self, forces: Vector3<f64>) -> Result<(), NumberError> {
        all_finite("the force of an axis, N", forces.iter())?;
        self.table_forces = forces;
        Ok(())
    }
}

impl<M, T, const F: usize, const N: usize, const A: usize> SimHand<M, T, F, N, A> {
    /// Returns the simulated fingers, for example to read their joint positions.
    #[must_use]
    pub fn fingers(&self) -> &[SimFinger<M, T, N, A>; F] {
        &self.fingers
    }

    /// Returns the simulated fingers for changes, for example to reset one.
    pub fn fingers_mut(&mut self) -> &mut [SimFinger<M, T, N, A>; F] {
        &mut self.fingers
    }

    /// Returns the simulated object; `None` if there is none.
    #[must_use]
    pub fn object(&self) -> Option<&SimObject> {
        self.object.as_ref()
    }

    /// Returns the simulated table; `None` if the palm does not move.
    #[must_use]
    pub fn table(&self) -> Option<&SimTable> {
        self.table.as_ref()
    }

    /// Returns for each finger the state of the contact between its tip and the object.
    #[must_use]
    pub fn object_contacts(&self) -> [SimContact; F] {
        self.tips.map(|tip| tip.object)
    }

    /// Returns the simulated time since the hand was made, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        // Counts stay exact for longer than any run.
        #[allow(clippy::cast_precision_loss, reason = "2^53 steps are 700 000 years")]
        let steps = self.steps as f64;
        steps * self.parameters.period_s
    }
}

fn check(wrench: &Wrench) -> Result<(), NumberError> {
    let parts = wrench.force.iter().chain(wrench.moment.iter());
    all_finite("a part of a wrench, N or N m", parts)
}
