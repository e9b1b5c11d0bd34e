use super::pneumatic::{Air, Pneumatic};
use crate::math::{clamp, exp};
use crate::number::{NumberError, positive};

/// A simulated actuator, which pulls one tendon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimDrive {
    /// The tension of a full command, N; commands are limited to `0..=max_n`.
    pub max_n: f64,
    /// The response of the tension to the command.
    pub kind: DriveKind,
}

/// The model of a simulated actuator: how the tension of its tendon follows the command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveKind {
    /// A first-order response, `f' = (command - f) / tau`, by Euler's forward method: the tension
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
    Tension(f64),
    Air(Air),
}

impl SimDrive {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        positive("the tension of a full command, N", self.max_n)?;
        match &self.kind {
            DriveKind::Euler { time_constant_s } | DriveKind::Exact { time_constant_s } => {
                positive("the time constant of a drive, s", *time_constant_s)
            }
            DriveKind::Pneumatic(pneumatic) => pneumatic.check(),
        }
    }

    /// At rest at a tension.
    pub(super) fn at(&self, tension: f64) -> DriveState {
        match &self.kind {
            DriveKind::Euler { .. } | DriveKind::Exact { .. } => DriveState::Tension(tension),
            DriveKind::Pneumatic(pneumatic) => DriveState::Air(pneumatic.at(tension)),
        }
    }

    /// One update of `dt` seconds, while the joints let the tendon in at `rate` (m/s); returns the tension that
    /// acts on the joints during it.
    pub(super) fn update(&self, state: &mut DriveState, command: f64, rate: f64, dt: f64) -> f64 {
        let command = clamp(command, 0.0, self.max_n);
        match (&self.kind, state) {
            (DriveKind::Euler { time_constant_s }, DriveState::Tension(tension)) => {
                let acting = *tension;
                *tension += dt * (command - acting) / time_constant_s;
                acting
            }
            (DriveKind::Exact { time_constant_s }, DriveState::Tension(tension)) => {
                let ratio = dt / time_constant_s;
                let gone = 1.0 - exp(-ratio);
                let error = command - *tension;
                *tension += error * gone;
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
