use super::pneumatic::{Air, Pneumatic};
use crate::math::{clamp, exp};
use crate::number::{NumberError, Requirement, check, finite, positive};

/// A simulated actuator, such as one that pulls a tendon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimDrive {
    /// The least effort, N or N m: 0 for one that can only pull. Commands are limited to `low..=high`.
    pub low: f64,
    /// The greatest effort, N or N m.
    pub high: f64,
    /// The response of the effort to the command.
    pub kind: DriveKind,
}

/// The model of a simulated actuator: how its effort follows the command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveKind {
    /// A first-order response, `f' = (command - f) / tau`, by Euler's forward method: the effort
    /// before an update acts during the update, as in the filtered actuators of `MuJoCo`. Stable
    /// for steps below `2 tau`.
    Euler {
        /// The time constant tau, s.
        time_constant_s: f64,
    },
    /// The exact first-order response: during an update the mean of the exponential acts.
    Exact {
        /// The time constant tau, s.
        time_constant_s: f64,
    },
    /// A valve, a cylinder and a tendon.
    Pneumatic(Pneumatic),
}

/// The state of a drive between two updates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum DriveState {
    Effort(f64),
    Air(Air),
}

impl SimDrive {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        let range = Requirement::AtLeast(self.low);
        finite("the least effort of a drive", self.low)?;
        check("the greatest effort of a drive", self.high, range)?;
        match &self.kind {
            DriveKind::Euler { time_constant_s } | DriveKind::Exact { time_constant_s } => {
                positive("the time constant of a drive, s", *time_constant_s)
            }
            DriveKind::Pneumatic(pneumatic) => {
                let what = "the least effort of a pneumatic drive, which cannot push,";
                check(what, self.low, Requirement::AtLeast(0.0))?;
                pneumatic.check()
            }
        }
    }

    /// At rest at an effort.
    pub(super) fn at(&self, effort: f64) -> DriveState {
        match &self.kind {
            DriveKind::Euler { .. } | DriveKind::Exact { .. } => DriveState::Effort(effort),
            DriveKind::Pneumatic(pneumatic) => DriveState::Air(pneumatic.at(effort)),
        }
    }

    /// One update of `dt` seconds, while the joints move it at `rate` (m/s or rad/s); returns the effort that
    /// acts on the joints during it.
    pub(super) fn update(&self, state: &mut DriveState, command: f64, rate: f64, dt: f64) -> f64 {
        let command = if command.is_nan() { 0.0 } else { command };
        let command = clamp(command, self.low, self.high);
        match (&self.kind, state) {
            (DriveKind::Euler { time_constant_s }, DriveState::Effort(effort)) => {
                let acting = *effort;
                *effort += dt * (command - acting) / time_constant_s;
                acting
            }
            (DriveKind::Exact { time_constant_s }, DriveState::Effort(effort)) => {
                let ratio = dt / time_constant_s;
                let gone = 1.0 - exp(-ratio);
                let error = command - *effort;
                *effort += error * gone;
                command - error * gone / ratio
            }
            (DriveKind::Pneumatic(pneumatic), DriveState::Air(air)) => {
                pneumatic.update(air, command, rate, dt)
            }
            // A state is made by its own drive.
            (_, state) => {
                *state = self.at(0.0);
                0.0
            }
        }
    }
}
