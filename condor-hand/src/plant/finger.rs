use heapless::Vec;
use nalgebra::{SVector, Vector3};

use super::check::all_finite;
use super::drive::{DriveState, SimDrive};
use super::joint::JointParameters;
use crate::dynamics::Dynamics;
use crate::math::{abs, clamp};
use crate::number::{NumberError, Requirement, Subject, check, positive};
use crate::servo::FingerReadings;
use crate::transmission::{Linear, Transmission};

/// The parameters of a [`SimFinger`], except for its mechanism and its transmission.
#[derive(Clone, Debug, PartialEq)]
pub struct FingerParameters<const N: usize, const A: usize> {
    /// The parameters of the joints that the finger has, proximal first.
    pub joints: Vec<JointParameters, N>,
    /// The actuators that it has, in the order of the transmission.
    pub drives: Vec<SimDrive, A>,
}

/// A simulated finger: a mechanism `M` of N joints that A actuators move by a transmission `T`.
///
/// ```
/// # use condor_hand::config::Hand;
/// use condor_hand::plant::PlantModel;
///
/// # let text = std::fs::read_to_string("hands/utah-mit.toml")?;
/// # let hand = Hand::<4, 4, 8>::from_toml(&text, "utah-mit.toml")?;
/// let index = &hand.fingers[0];
/// let start = [0.0, 0.3, 0.4, 0.4].into(); // rad
/// let mut finger = PlantModel::default().finger(index, index.chain(), index.transmission()?, start)?;
/// let pull = [30.0, 10.0, 30.0, 10.0, 30.0, 10.0, 30.0, 10.0]; // N
/// finger.step(1.0 / 400.0, 5, &pull, &hand.gravity.into())?;
/// assert!(finger.qd()[1] > 0.0);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SimFinger<M, T, const N: usize, const A: usize> {
    mechanism: M,
    transmission: T,
    parameters: FingerParameters<N, A>,
    q: SVector<f64, N>,
    qd: SVector<f64, N>,
    drives: [DriveState; A],
    efforts: [f64; A],
}

impl<M, T, const N: usize, const A: usize> SimFinger<M, T, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
{
    /// Makes a finger that is at rest at the joint positions `q` (rad), with the efforts of its
    /// actuators that are nearest to zero. `mechanism` is the model of its links, and `transmission` has its actuators.
    ///
    /// # Errors
    /// [`NumberError`] for the first parameter that is wrong, or if the mass matrix is not positive
    /// definite at `q`.
    pub fn new(
        mechanism: M,
        transmission: T,
        parameters: FingerParameters<N, A>,
        q: SVector<f64, N>,
    ) -> Result<Self, NumberError> {
        parameters
            .joints
            .iter()
            .try_for_each(JointParameters::check)?;
        parameters.drives.iter().try_for_each(SimDrive::check)?;
        let mut finger = Self {
            mechanism,
            transmission,
            parameters,
            q: SVector::zeros(),
            qd: SVector::zeros(),
            drives: [DriveState::Effort(0.0); A],
            efforts: [0.0; A],
        };
        let mut at_rest = [0.0; A];
        for (effort, drive) in at_rest.iter_mut().zip(&finger.parameters.drives) {
            *effort = clamp(0.0, drive.low, drive.high);
        }
        finger.reset(q, at_rest)?;
        finger.accelerations(&Vector3::zeros(), &SVector::zeros(), &SVector::zeros())?;
        Ok(finger)
    }

    /// Puts the finger at rest at the joint positions `q` (rad), with constant efforts (N, or N m)
    /// of its actuators.
    ///
    /// # Errors
    /// [`NumberError`] if a position is not finite, or an effort is not one of its actuator; the finger does not change then.
    pub fn reset(&mut self, q: SVector<f64, N>, efforts: [f64; A]) -> Result<(), NumberError> {
        all_finite("a joint position to begin from, rad", q.iter())?;
        for (&effort, drive) in efforts.iter().zip(&self.parameters.drives) {
            let within = Requirement::Within(drive.low, drive.high);
            check("an effort to begin from", effort, within)?;
        }
        self.q = q;
        self.qd = SVector::zeros();
        self.efforts = efforts;
        self.transmission.set_position(&self.q);
        let drives = self.parameters.drives.iter().zip(&efforts);
        for (state, (drive, &effort)) in self.drives.iter_mut().zip(drives) {
            *state = drive.at(effort);
        }
        Ok(())
    }

    /// Returns the positions of the actuators, rad or m, by their arms at the present posture.
    #[must_use]
    pub fn actuator_positions(&self) -> [f64; A] {
        self.linear().actuators(&self.q)
    }

    /// Returns the readings of exact sensors of the finger. The reading of the tactile sensor is
    /// zero.
    #[must_use]
    pub fn readings(&self) -> FingerReadings<N, A> {
        FingerReadings {
            position: self.q,
            actuator_position: self.actuator_positions(),
            effort: self.efforts,
            touch: 0.0,
        }
    }

    /// Simulates `dt` seconds in `updates` equal updates. `commands` (N, or N m) are the constant
    /// commands of the actuators; a NaN counts as zero. `gravity` is in the axes of the palm, m/s², as in
    /// [`Dynamics`].
    ///
    /// # Errors
    /// [`NumberError`] if `dt` is not above zero, the mass matrix is not positive definite, or a new
    /// state would not be finite.
    pub fn step(
        &mut self,
        dt: f64,
        updates: u32,
        commands: &[f64; A],
        gravity: &Vector3<f64>,
    ) -> Result<(), NumberError> {
        let dt = dt / f64::from(updates.max(1));
        for _ in 0..updates {
            self.advance(dt, commands, gravity, &SVector::zeros())?;
        }
        Ok(())
    }

    /// Simulates one update of `dt` seconds, like [`step`](Self::step) with a single update.
    /// `torque` (N m) acts on the joints in addition to the actuators, for example from contacts.
    ///
    /// # Errors
    /// [`NumberError`] if `dt` is not above zero, the mass matrix is not positive definite, or the
    /// new state would not be finite; the finger does not change then.
    pub fn advance(
        &mut self,
        dt: f64,
        commands: &[f64; A],
        gravity: &Vector3<f64>,
        torque: &SVector<f64, N>,
    ) -> Result<(), NumberError> {
        positive("the time of an update, s", dt)?;
        let (drives, efforts) = self.drive(dt, commands);
        let mut applied: SVector<f64, N> = self.linear().torque(&efforts) + torque;
        let mut armature = SVector::<f64, N>::zeros();
        let loads = self.loads(&efforts);
        let state = self.q.as_slice().iter().zip(self.qd.as_slice()).zip(&loads);
        let places = applied
            .as_mut_slice()
            .iter_mut()
            .zip(armature.as_mut_slice());
        let joints = self.parameters.joints.iter().zip(state.zip(places));
        for (parameters, (((&q, &qd), &load), (applied, armature))) in joints {
            let passive = parameters.passive(q, qd, load);
            *applied += passive.torque;
            *armature = dt * passive.slope;
        }
        let qdd = self.accelerations(gravity, &applied, &armature)?;
        let qd = self.qd + qdd * dt;
        let q = self.q + qd * dt;
        let (joints, actuators) = (self.parameters.joints.len(), self.parameters.drives.len());
        let (rates, positions) = (qd.as_slice().iter(), q.as_slice().iter());
        all_finite(
            "the rate that a joint would have, rad/s",
            rates.take(joints),
        )?;
        all_finite(
            "the position that a joint would have, rad",
            positions.take(joints),
        )?;
        all_finite("an effort", efforts.iter().take(actuators))?;
        self.q = q;
        self.qd = qd;
        self.drives = drives;
        self.efforts = efforts;
        self.transmission.set_position(&self.q);
        Ok(())
    }

    /// The drives after an update, and the efforts that act during it.
    fn drive(&self, dt: f64, commands: &[f64; A]) -> ([DriveState; A], [f64; A]) {
        let (mut states, mut efforts) = (self.drives, [0.0; A]);
        let rates = self.linear().actuators(&self.qd);
        let drives = self.parameters.drives.iter().zip(&mut states);
        let asked = efforts.iter_mut().zip(commands).zip(rates);
        for ((drive, state), ((effort, &command), rate)) in drives.zip(asked) {
            *effort = drive.update(state, command, rate, dt);
        }
        (states, efforts)
    }

    /// The torques of the efforts at each joint without their signs, N m.
    fn loads(&self, efforts: &[f64; A]) -> [f64; N] {
        let mut loads = [0.0; N];
        let columns = self.linear().arms().iter().zip(efforts);
        for (arms, effort) in columns.take(self.parameters.drives.len()) {
            for (load, arm) in loads.iter_mut().zip(arms) {
                *load += abs(arm * effort);
            }
        }
        loads
    }

    /// Returns the arms of the actuators at the present posture.
    #[must_use]
    pub fn linear(&self) -> &Linear<N, A> {
        self.transmission.linear()
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

impl<M, T, const N: usize, const A: usize> SimFinger<M, T, N, A> {
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

    /// Returns the efforts of the actuators during the last update, N or N m, as sensors would measure
    /// them.
    #[must_use]
    pub fn efforts(&self) -> &[f64; A] {
        &self.efforts
    }

    /// Returns the model of the finger's links that was passed to [`new`](Self::new).
    #[must_use]
    pub fn mechanism(&self) -> &M {
        &self.mechanism
    }

    /// Returns the parameters of the finger that were passed to [`new`](Self::new).
    #[must_use]
    pub fn parameters(&self) -> &FingerParameters<N, A> {
        &self.parameters
    }
}
