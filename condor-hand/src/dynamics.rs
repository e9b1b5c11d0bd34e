//! The torques that a motion takes, and the motion that torques cause.
//!
//! Gravity is an argument, in the axes of the palm, m/s²: for a palm in any orientation, and for a
//! palm that is accelerated by `a` the caller passes `g - a`.

mod chain;
mod drive;
mod finger;

pub use drive::DriveDynamics;

use nalgebra::{SMatrix, SVector, Vector3};

/// The rigid-body dynamics of a serial mechanism of N joints: the torques that a motion needs, and
/// the motion that torques cause. Friction and armature (the inertia of the drives) are not
/// included; a [`DriveDynamics`] adds them.
///
/// In all methods `gravity` is the acceleration of gravity in the axes of the palm, m/s². For a
/// sliding joint, read m for rad, N for N m and kg for kg m². For finite arguments the results are
/// finite, unless a product overflows; no method panics.
pub trait Dynamics<const N: usize> {
    /// Returns the torques (N m) for the accelerations `qdd` (rad/s²) at the positions `q` (rad)
    /// and rates `qd` (rad/s).
    fn inverse_dynamics(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        qdd: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, N>;

    /// Returns the torques that hold the rates constant: gravity, Coriolis and centrifugal torques,
    /// N m.
    fn bias(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, N>;

    /// Returns the torques that hold the joints still, N m.
    fn gravity_torque(&self, q: &SVector<f64, N>, gravity: &Vector3<f64>) -> SVector<f64, N>;

    /// Returns the mass matrix: symmetric, kg m².
    fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N>;

    /// Returns the accelerations (rad/s²) that the torques cause, with the inertia of the drives
    /// (`armature`, kg m²) added to the diagonal of the mass matrix. Returns `None` if that matrix
    /// is not positive definite, or if an acceleration is not finite; so a NaN among the arguments
    /// never appears in a result.
    fn forward_dynamics(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        torque: &SVector<f64, N>,
        gravity: &Vector3<f64>,
        armature: &SVector<f64, N>,
    ) -> Option<SVector<f64, N>>;
}
