//! The simulated hand that a configuration describes.

use nalgebra::Vector3;

use super::{
    AxisParameters, DriveKind, FingerParameters, HandParameters, JointParameters, SimDrive,
    SimFinger, SimStop, SimSurface, SimTable,
};
use crate::dynamics::Dynamics;
use crate::list::list;
use crate::math::{abs, max};
use crate::transmission::Transmission;
use crate::{NumberError, Requirement, Subject, config};

/// The parameters of a simulated hand that its configuration does not have. The methods make the
/// simulated parts of a configured hand.
///
/// The default has exact actuators, soft mechanical stops, five updates in a period and points as
/// tips: a machine that touches nothing.
///
/// ```
/// use condor_hand::{config::Hand, plant::PlantModel};
///
/// let text = std::fs::read_to_string("hands/utah-mit.toml")?;
/// let hand = Hand::<4, 4, 8>::from_toml(&text, "utah-mit.toml")?;
/// let thumb = &hand.fingers[3];
/// let model = PlantModel { updates: 25, ..PlantModel::default() };
/// let start = [0.0, 0.3, 0.4, 0.4].into(); // rad
/// let finger = model.finger(thumb, thumb.chain(), thumb.transmission()?, start)?;
/// assert_eq!(finger.readings().position[2], 0.4);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PlantModel {
    /// The function that returns the kind of actuator with this small-signal pole (Hz).
    pub actuator: fn(f64) -> DriveKind,
    /// The mechanical stop of a joint at its limits; the soft stops of the configuration are in the
    /// servos.
    pub joint_stop: SimStop,
    /// The mechanical stop of an axis of the table at its limits.
    pub axis_stop: SimStop,
    /// The number of equal updates in one period of the servos.
    pub updates: u32,
    /// The radius of the sphere about each tip that can touch things, m.
    pub tip_radius: f64,
    /// The surface between a tip and the object; the configuration's friction replaces its friction, if
    /// there is one.
    pub surface: SimSurface,
}

impl Default for PlantModel {
    fn default() -> Self {
        Self {
            actuator: DriveKind::exact,
            joint_stop: SimStop {
                stiffness: 5.0,
                damping: 0.01,
            },
            axis_stop: SimStop {
                stiffness: 1e5,
                damping: 500.0,
            },
            updates: 5,
            tip_radius: 0.0,
            surface: SimSurface {
                stiffness: 1e3,
                damping: 1.0,
                shear_stiffness: 1e3,
                shear_damping: 1.0,
                friction: 0.5,
            },
        }
    }
}

impl DriveKind {
    /// Returns a drive with a first-order response by Euler's method, whose pole is at `pole_hz`
    /// (Hz).
    #[must_use]
    pub fn euler(pole_hz: f64) -> Self {
        Self::Euler {
            time_constant_s: time_constant_s(pole_hz),
        }
    }

    /// Returns a drive with an exact first-order response, whose pole is at `pole_hz` (Hz).
    #[must_use]
    pub fn exact(pole_hz: f64) -> Self {
        Self::Exact {
            time_constant_s: time_constant_s(pole_hz),
        }
    }
}

fn time_constant_s(pole_hz: f64) -> f64 {
    1.0 / (core::f64::consts::TAU * pole_hz)
}

impl PlantModel {
    /// Returns the parameters of the simulation of a configured finger, except for its mechanism and
    /// its transmission.
    #[must_use]
    pub fn finger_parameters<const N: usize, const A: usize>(
        &self,
        finger: &config::Finger<N, A>,
    ) -> FingerParameters<N, A> {
        FingerParameters {
            joints: list(finger.joints.iter().map(|joint| self.joint(joint))),
            drives: list(finger.actuators.iter().map(|actuator| self.drive(actuator))),
        }
    }

    /// Makes the simulation of a configured finger. It is at rest at the joint positions `q` (rad),
    /// with the efforts with which its controller begins.
    ///
    /// `mechanism` is the model of the simulated links, and `transmission` has the simulated actuators; they may differ
    /// from those in the controller.
    ///
    /// # Errors
    /// [`NumberError`] for a number that no plant can have.
    pub fn finger<M, T, const N: usize, const A: usize>(
        &self,
        finger: &config::Finger<N, A>,
        mechanism: M,
        transmission: T,
        q: nalgebra::SVector<f64, N>,
    ) -> Result<SimFinger<M, T, N, A>, NumberError>
    where
        M: Dynamics<N>,
        T: Transmission<N, A>,
    {
        let parameters = self.finger_parameters(finger);
        let mut plant = SimFinger::new(mechanism, transmission, parameters, q)?;
        plant.reset(q, finger.efforts_at_rest())?;
        Ok(plant)
    }

    /// Returns the parameters of the simulation of a configured hand, except for its fingers.
    #[must_use]
    pub fn hand_parameters<const F: usize, const N: usize, const A: usize>(
        &self,
        hand: &config::Hand<F, N, A>,
    ) -> HandParameters {
        let contact = hand.contact.as_ref();
        let surface = SimSurface {
            friction: contact.map_or(self.surface.friction, |contact| contact.friction),
            ..self.surface
        };
        HandParameters {
            period_s: 1.0 / f64::from(hand.servo_hz),
            updates: self.updates,
            gravity: Vector3::from(hand.gravity),
            tip_radius: self.tip_radius,
            tip_object: surface,
        }
    }

    /// Makes the simulation of a configured table. Its axes must lie along x, y and z of the palm,
    /// in either direction and in any order. An axis that the configuration does not have does not
    /// move.
    ///
    /// # Errors
    /// [`NumberError`] for a number that no plant can have, or for an axis that has another
    /// direction or that of another axis.
    pub fn table(&self, table: &config::TableSettings) -> Result<SimTable, NumberError> {
        let mut axes = [AxisParameters {
            mass: 1.0,
            viscous: 0.0,
            max_n: 1.0,
            range: (-1.0, 1.0),
            stop: self.axis_stop,
        }; 3];
        let mut taken = [false; 3];
        for (number, axis) in table.axes.iter().enumerate() {
            let of_palm = along(axis.direction);
            let place = of_palm.and_then(|index| axes.get_mut(index).zip(taken.get_mut(index)));
            let Some((place, taken)) = place.filter(|(_, taken)| !**taken) else {
                let parts = axis.direction.iter().zip(taken);
                let free = parts.filter(|(_, taken)| !taken);
                return Err(NumberError {
                    at: Subject::Axis(number as u16),
                    what: "the part of its direction along an axis of the palm that no other has",
                    value: free.fold(0.0, |most, (part, _)| max(most, abs(*part))),
                    must: Requirement::Equal(1.0),
                });
            };
            *taken = true;
            let (low, high) = (axis.limits.low, axis.limits.high);
            let backwards = axis.direction.iter().sum::<f64>() < 0.0;
            *place = AxisParameters {
                mass: axis.mass_kg,
                viscous: axis.viscous,
                max_n: axis.max_n,
                range: if backwards {
                    (-high, -low)
                } else {
                    (low, high)
                },
                stop: self.axis_stop,
            };
        }
        SimTable::new(axes)
    }

    fn joint(&self, joint: &config::Joint) -> JointParameters {
        let mut friction = joint.friction;
        if friction.coulomb_rate == 0.0 {
            friction.coulomb_rate = 1e-3;
        }
        JointParameters {
            friction,
            stiffness: 0.0,
            rest: 0.0,
            range: (joint.limits.low, joint.limits.high),
            stop: self.joint_stop,
        }
    }

    fn drive<const N: usize>(&self, actuator: &config::Actuator<N>) -> SimDrive {
        let (low, high) = actuator.limits().command_range();
        SimDrive {
            low,
            high,
            kind: (self.actuator)(actuator.pole_hz),
        }
    }
}

/// The axis of the palm that a unit vector lies along.
fn along(direction: [f64; 3]) -> Option<usize> {
    direction
        .iter()
        .position(|&part| abs(abs(part) - 1.0) < 1e-9)
}
