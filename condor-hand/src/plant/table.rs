use nalgebra::Vector3;

use super::check::ordered;
use super::joint::{Passive, SimStop};
use crate::math::{clamp, is_finite};
use crate::number::{NumberError, not_negative, positive};

/// The parameters of one axis of a [`SimTable`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisParameters {
    /// The mass of everything that this axis moves, including the hand, kg.
    pub mass: f64,
    /// Viscous friction, N s/m.
    pub viscous: f64,
    /// The greatest force of its motor to either side, N.
    pub max_n: f64,
    /// The range of its position, m.
    pub range: (f64, f64),
    /// The mechanical stop at the ends of the range.
    pub stop: SimStop,
}

/// A simulated table, which carries the palm on three sliding axes along x, y and z. The axes are
/// balanced against gravity, and the forces of the fingers do not move them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimTable {
    axes: [AxisParameters; 3],
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    acceleration: Vector3<f64>,
}

impl AxisParameters {
    fn check(&self) -> Result<(), NumberError> {
        positive("the mass of an axis, kg", self.mass)?;
        not_negative("the viscous friction of an axis, N s/m", self.viscous)?;
        positive("the force of an axis, N", self.max_n)?;
        ordered("the end of an axis' range, m", self.range)?;
        self.stop.check()
    }

    /// The velocity after an update.
    fn accelerate(&self, position: f64, velocity: f64, force: f64, dt: f64) -> f64 {
        let force = if is_finite(force) { force } else { 0.0 };
        let mut passive = Passive {
            torque: -self.viscous * velocity,
            slope: self.viscous,
        };
        passive.add(self.stop.push(self.range, position, velocity));
        let force = clamp(force, -self.max_n, self.max_n) + passive.torque;
        velocity + dt * force / (self.mass + dt * passive.slope)
    }
}

impl SimTable {
    /// Makes a table that is at rest at the position zero. `axes` are x, y and z of the palm.
    ///
    /// # Errors
    /// [`NumberError`] for the first parameter that is wrong.
    pub fn new(axes: [AxisParameters; 3]) -> Result<Self, NumberError> {
        axes.iter().try_for_each(AxisParameters::check)?;
        Ok(Self {
            axes,
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        })
    }

    /// Simulates one update of `dt` seconds with the forces of the motors (N). A force that is not
    /// finite counts as zero; others are limited to those that the motors have.
    ///
    /// # Errors
    /// [`NumberError`] if `dt` is not above zero.
    pub fn advance(&mut self, dt: f64, forces: &Vector3<f64>) -> Result<(), NumberError> {
        positive("the time of an update, s", dt)?;
        let state = self.position.iter_mut().zip(self.velocity.iter_mut());
        let state = state.zip(self.acceleration.iter_mut());
        for (((position, velocity), acceleration), (axis, &force)) in
            state.zip(self.axes.iter().zip(forces.iter()))
        {
            let next = axis.accelerate(*position, *velocity, force, dt);
            *acceleration = (next - *velocity) / dt;
            *velocity = next;
            *position += dt * next;
        }
        Ok(())
    }

    /// Returns the positions of the table's axes, m.
    #[must_use]
    pub fn position(&self) -> &Vector3<f64> {
        &self.position
    }

    /// Returns the velocities of the table's axes, m/s.
    #[must_use]
    pub fn velocity(&self) -> &Vector3<f64> {
        &self.velocity
    }

    /// Returns the accelerations of the table's axes during the last update, m/s².
    #[must_use]
    pub fn acceleration(&self) -> &Vector3<f64> {
        &self.acceleration
    }
}
