use nalgebra::{SVector, Vector3};

use super::check::all_finite;
use super::drive::{DriveState, SimDrive};
use super::joint::JointParameters;
use crate::dynamics::Dynamics;
use crate::math::abs;
use crate::number::{NumberError, Requirement, Subject, not_negative, positive};
use crate::servo::FingerReadings;
use crate::tendon::{MomentArms, Pair, TendonPairs};

/// The parameters of a [`SimFinger`], except for its mechanism.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerParameters<const N: usize> {
    /// The moment arms of the tendons.
    pub arms: MomentArms<N>,
    /// The parameters of the joints, proximal first.
    pub joints: [JointParameters; N],
    /// The actuators of the tendons.
    pub drives: TendonPairs<SimDrive, N>,
}

/// A simulated finger: a mechanism `M` of N joints that is pulled by 2 N tendons.
///
/// ```
/// # use condor_hand::config::Hand;
/// use condor_hand::plant::PlantModel;
/// use condor_hand::tendon::Pair;
///
/// # let text = std::fs::read_to_string("hands/utah-mit.toml")?;
/// # let hand = Hand::<4, 4>::from_toml(&text, "utah-mit.toml")?;
/// let index = &hand.fingers[0];
/// let mut finger = PlantModel::default().finger(index, index.chain(), [0.0, 0.3, 0.4, 0.4].into())?;
/// let pull = [Pair { flexor: 30.0, extensor: 10.0 }; 4]; // N
/// finger.step(1.0 / 400.0, 5, &pull, &hand.gravity.into())?;
/// assert!(finger.qd()[1] > 0.0);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SimFinger<M, const N: usize> {
    mechanism: M,
    parameters: FingerParameters<N>,
    q: SVector<f64, N>,
    qd: SVector<f64, N>,
    drives: TendonPairs<DriveState, N>,
    tensions: TendonPairs<f64, N>,
}

impl<M: Dynamics<N>, const N: usize> SimFinger<M, N> {
    /// Makes a finger that is at rest at the joint positions `q` (rad), with zero tension in all
    /// tendons. `mechanism` is the model of its links.
    ///
    /// # Errors
    /// [`NumberError`] for the first parameter that is wrong, or if the mass matrix is not positive
    /// definite at `q`.
    pub fn new(
        mechanism: M,
        parameters: FingerParameters<N>,
        q: SVector<f64, N>,
    ) -> Result<Self, NumberError> {
        parameters
            .joints
            .iter()
            .try_for_each(JointParameters::check)?;
        for pair in &parameters.drives {
            pair.flexor.check()?;
            pair.extensor.check()?;
        }
        let still = DriveState::Tension(0.0);
        let mut finger = Self {
            mechanism,
            parameters,
            q: SVector::zeros(),
            qd: SVector::zeros(),
            drives: [Pair::both(still); N],
            tensions: [Pair::both(0.0); N],
        };
        finger.reset(q, [Pair::both(0.0); N])?;
        finger.accelerations(&Vector3::zeros(), &SVector::zeros(), &SVector::zeros())?;
        Ok(finger)
    }

    /// Puts the finger at rest at the joint positions `q` (rad), with the constant tensions
    /// `tensions` (N) in its tendons.
    ///
    /// # Errors
    /// [`NumberError`] if a position is not finite, or a tension is not finite or below zero; the
    /// finger does not change then.
    pub fn reset(
        &mut self,
        q: SVector<f64, N>,
        tensions: TendonPairs<f64, N>,
    ) -> Result<(), NumberError> {
        all_finite("a joint position to begin from, rad", q.iter())?;
        for pair in &tensions {
            not_negative("a tension to begin from, N", pair.flexor)?;
            not_negative("a tension to begin from, N", pair.extensor)?;
        }
        self.q = q;
        self.qd = SVector::zeros();
        self.tensions = tensions;
        let drives = self.parameters.drives.iter().zip(&tensions);
        for (state, (drive, tension)) in self.drives.iter_mut().zip(drives) {
            state.flexor = drive.flexor.at(tension.flexor);
            state.extensor = drive.extensor.at(tension.extensor);
        }
        Ok(())
    }

    /// Simulates `dt` seconds in `updates` equal updates. `commands` (N) are the constant commands
    /// of the actuators; a NaN counts as zero. `gravity` is in the axes of the palm, m/s², as in
    /// [`Dynamics`].
    ///
    /// # Errors
    /// [`NumberError`] if `dt` is not above zero, the mass matrix is not positive definite, or a new
    /// state would not be finite.
    pub fn step(
        &mut self,
        dt: f64,
        updates: u32,
        commands: &TendonPairs<f64, N>,
        gravity: &Vector3<f64>,
    ) -> Result<(), NumberError> {
        let dt = dt / f64::from(updates.max(1));
        for _ in 0..updates {
            self.advance(dt, commands, gravity, &SVector::zeros())?;
        }
        Ok(())
    }

    /// Simulates one update of `dt` seconds, like [`step`](Self::step) with a single update.
    /// `torque` (N m) acts on the joints in addition to the tendons, for example from contacts.
    ///
    /// # Errors
    /// [`NumberError`] if `dt` is not above zero, the mass matrix is not positive definite, or the
    /// new state would not be finite; the finger does not change then.
    pub fn advance(
        &mut self,
        dt: f64,
        commands: &TendonPairs<f64, N>,
        gravity: &Vector3<f64>,
        torque: &SVector<f64, N>,
    ) -> Result<(), NumberError> {
        positive("the time of an update, s", dt)?;
        let (drives, tensions) = self.pull(dt, commands);
        let mut applied: SVector<f64, N> = self.parameters.arms.torque(&tensions) + torque;
        let mut armature = SVector::<f64, N>::zeros();
        for (joint, parameters) in self.parameters.joints.iter().enumerate() {
            let (Some(&q), Some(&qd)) = (self.q.get(joint), self.qd.get(joint)) else {
                continue;
            };
            let passive = parameters.passive(q, qd, self.load(joint, &tensions));
            if let Some(applied) = applied.get_mut(joint) {
                *applied += passive.torque;
            }
            if let Some(armature) = armature.get_mut(joint) {
                *armature = dt * passive.slope;
            }
        }
        let qdd = self.accelerations(gravity, &applied, &armature)?;
        let qd = self.qd + qdd * dt;
        let q = self.q + qd * dt;
        all_finite("the rate that a joint would have, rad/s", qd.iter())?;
        all_finite("the position that a joint would have, rad", q.iter())?;
        for pair in &tensions {
            all_finite("a tension, N", [&pair.flexor, &pair.extensor])?;
        }
        self.q = q;
        self.qd = qd;
        self.drives = drives;
        self.tensions = tensions;
        Ok(())
    }

    /// The drives after an update, and the tensions that act during it.
    fn pull(
        &self,
        dt: f64,
        commands: &TendonPairs<f64, N>,
    ) -> (TendonPairs<DriveState, N>, TendonPairs<f64, N>) {
        let mut states = self.drives;
        let mut tensions = [Pair::both(0.0); N];
        // The rates at which the joints let the tendons in: the negative of those of their lengths.
        let rates = self.parameters.arms.length_rates(&self.qd);
        let inputs = self.parameters.drives.iter().zip(commands).zip(&rates);
        let tendons = states.iter_mut().zip(&mut tensions).zip(inputs);
        for ((state, tension), ((drive, command), rate)) in tendons {
            let flexor = &mut state.flexor;
            tension.flexor = (drive.flexor).update(flexor, command.flexor, -rate.flexor, dt);
            let extensor = &mut state.extensor;
            let (pull, rate) = (command.extensor, -rate.extensor);
            tension.extensor = drive.extensor.update(extensor, pull, rate, dt);
        }
        (states, tensions)
    }

    /// The torques of a joint's own tendons without their signs, N m.
    fn load(&self, joint: usize, tensions: &TendonPairs<f64, N>) -> f64 {
        let row = self.parameters.arms.rows().get(joint);
        let arm = row.and_then(|row| row.get(joint));
        arm.zip(tensions.get(joint)).map_or(0.0, |(arm, tension)| {
            abs(arm.flexor) * tension.flexor + abs(arm.extensor) * tension.extensor
        })
    }

    fn accelerations(
        &self,
        gravity: &Vector3<f64>,
        torque: &SVector<f64, N>,
        added: &SVector<f64, N>,
    ) -> Result<SVector<f64, N>, NumberError> {
        let mut armature = *added;
        for (armature, joint) in armature.iter_mut().zip(&self.parameters.joints) {
            *armature += joint.friction.armature;
        }
        self.mechanism
            .forward_dynamics(&self.q, &self.qd, torque, gravity, &armature)
            .ok_or(NumberError {
                at: Subject::Whole,
                what: "the acceleration of the joints, rad/s², for which the mass matrix must be positive definite,",
                value: f64::NAN,
                must: Requirement::Finite,
            })
    }
}

impl<M, const N: usize> SimFinger<M, N> {
    /// Returns the present positions of the finger's joints, rad.
    #[must_use]
    pub fn q(&self) -> &SVector<f64, N> {
        &self.q
    }

    /// Returns the present rates of the finger's joints, rad/s.
    #[must_use]
    pub fn qd(&self) -> &SVector<f64, N> {
        &self.qd
    }

    /// Returns the tensions of the tendons during the last update, N, as sensors in the tendons
    /// would measure them.
    #[must_use]
    pub fn tensions(&self) -> &TendonPairs<f64, N> {
        &self.tensions
    }

    /// Returns the readings of exact sensors of the finger. The reading of the tactile sensor is
    /// zero.
    #[must_use]
    pub fn readings(&self) -> FingerReadings<N> {
        FingerReadings {
            position: self.q,
            tension: self.tensions,
            touch: 0.0,
        }
    }

    /// Returns the model of the finger's links that was passed to [`new`](Self::new).
    #[must_use]
    pub fn mechanism(&self) -> &M {
        &self.mechanism
    }

    /// Returns the parameters of the finger that were passed to [`new`](Self::new).
    #[must_use]
    pub fn parameters(&self) -> &FingerParameters<N> {
        &self.parameters
    }
}
