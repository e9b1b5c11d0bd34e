//! The rates of joints for a velocity of the tip, and how well a posture moves the tip.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::inverse::check_finite;
use super::{InverseError, Jacobian, Kinematics};
use crate::control::linear::Ldl;
use crate::math::{Real, acos, is_finite, real, sin_cos, sqrt};

/// Returns the rates of the joints (rad/s) that move the tip at `velocity` (m/s, in the palm), plus
/// `self_motion` (rad/s) along the direction that does not move the tip, if there is one.
///
/// See [`damped_rates`] for `damping`.
///
/// # Errors
///
/// Those of [`damped_rates`]; [`InverseError::NotFinite`] if `self_motion` is not finite.
pub fn joint_rates<T: Real, const N: usize>(
    mechanism: &impl Kinematics<T, N>,
    q: &SVector<T, N>,
    velocity: &Vector3<T>,
    damping: T,
    self_motion: T,
) -> Result<SVector<T, N>, InverseError> {
    check_finite("the rate of self-motion", [&self_motion])?;
    let (_, jacobian) = mechanism.kinematics(q);
    let rates = damped_rates(&jacobian, velocity, damping)?;
    if self_motion == T::zero() {
        return Ok(rates);
    }
    let along = mechanism.self_motion(q).unwrap_or_else(SVector::zeros);
    Ok(rates + along * self_motion)
}

/// Returns the damped least-squares rates `Jᵀ (J Jᵀ + μ² 1)⁻¹ v` (rad/s) for the velocity v of the
/// tip (m/s), with the linear rows of J.
///
/// `damping` is μ, m/rad: it bounds the rates near singularities by `|v| / 2μ` at the price of a
/// slower tip, in each direction by `σ² / (σ² + μ²)` with the singular value σ. Without damping the
/// answer is that of the pseudo-inverse (Nakamura and Hanafusa, "Inverse kinematic solutions with
/// singularity robustness for robot manipulator control", 1986).
///
/// # Errors
///
/// [`InverseError::NotFinite`], and [`InverseError::Singular`] where the damping is too small for
/// the Jacobian.
pub fn damped_rates<T: Real, const N: usize>(
    jacobian: &Jacobian<T, N>,
    velocity: &Vector3<T>,
    damping: T,
) -> Result<SVector<T, N>, InverseError> {
    check_finite("an entry of the Jacobian", jacobian.iter())?;
    check_finite("a velocity", velocity.iter())?;
    check_finite("the damping", [&damping])?;
    let linear = linear(jacobian);
    damped(&linear, velocity, damping).ok_or_else(|| InverseError::Singular {
        damping: damping.to_f64(),
    })
}

/// Returns the volume that unit rates of the joints give the velocity of the tip, `√det (J Jᵀ)`, in
/// (m/rad)³: zero at a singularity (Yoshikawa, "Manipulability of robotic mechanisms", 1985), and
/// where an entry is not finite or its square is not.
#[must_use]
pub fn manipulability<T: Real, const N: usize>(jacobian: &Jacobian<T, N>) -> T {
    let volume = sqrt(gram(jacobian).determinant());
    if is_finite(volume) { volume } else { T::zero() }
}

/// Returns the singular values of the linear rows of a Jacobian, largest first, m/rad: how fast the
/// tip moves for unit rates of the joints in its best direction, across, and in its worst.
///
/// The least is exact to √ε of the largest. All are zero where an entry of the Jacobian is not finite
/// or its square is not. From the eigenvalues of `J Jᵀ` in closed form (Smith,
/// "Eigenvalues of a symmetric 3 × 3 matrix", 1961).
#[must_use]
pub fn singular_values<T: Real, const N: usize>(jacobian: &Jacobian<T, N>) -> [T; 3] {
    let gram = gram(jacobian);
    let third = real::<T>(1.0 / 3.0);
    let mean = gram.trace() * third;
    let deviator = gram - Matrix3::from_diagonal_element(mean);
    let spread = sqrt(deviator.norm_squared() * real::<T>(1.0 / 6.0));
    if spread <= T::zero() {
        return [sqrt(mean); 3];
    }
    let half = (deviator / spread).determinant() * real(0.5);
    let angle = acos(half) * third;
    let along = |angle: T| mean + (spread + spread) * sin_cos(angle).1;
    let largest = along(angle);
    let least = along(angle + T::two_pi() * third);
    [largest, gram.trace() - largest - least, least].map(sqrt)
}

/// `J Jᵀ` of the linear rows; zero where that is not finite, which no square root would show.
fn gram<T: Real, const N: usize>(jacobian: &Jacobian<T, N>) -> Matrix3<T> {
    let linear = linear(jacobian);
    let gram = linear * linear.transpose();
    if gram.iter().all(|&entry| is_finite(entry)) {
        gram
    } else {
        Matrix3::zeros()
    }
}

/// The linear rows.
pub(super) fn linear<T: Real, const N: usize>(jacobian: &Jacobian<T, N>) -> SMatrix<T, 3, N> {
    jacobian.fixed_rows::<3>(0).into_owned()
}

pub(super) fn damped<T: Real, const N: usize>(
    jacobian: &SMatrix<T, 3, N>,
    velocity: &Vector3<T>,
    damping: T,
) -> Option<SVector<T, N>> {
    let square = Matrix3::from_diagonal_element(damping * damping);
    let gram = jacobian * jacobian.transpose() + square;
    // What is singular to rounding is singular.
    let least = real::<T>(4.0) * T::default_epsilon() * gram.trace();
    let solution = Ldl::with_least_pivot(&gram, least)?.solve(velocity);
    let rates = jacobian.transpose() * solution;
    rates.iter().all(|&rate| is_finite(rate)).then_some(rates)
}
