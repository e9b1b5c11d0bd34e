use nalgebra::{SMatrix, SVector, Vector3};

use super::inverse::check_finite;
use super::rates::{damped, linear};
use super::{InverseError, JointLimits, Kinematics};
use crate::math::{Real, max, min, real, sqrt};

/// The parameters of [`search`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchOptions<T: Real = f64> {
    /// The distance from the target at which the search ends, m.
    pub tolerance: T,
    /// The least damping, m/rad; a hundredth of the length of the mechanism is a good value.
    pub damping: T,
    /// The greatest number of times that the Jacobian is computed.
    pub iterations: u32,
}

/// Searches joint positions within the limits that bring the tip to `target` (m, in the palm), for
/// any mechanism, from `start` on.
///
/// The method is damped least squares (Levenberg-Marquardt: Wampler, "Manipulator inverse kinematic
/// solutions based on vector formulations and damped least-squares methods", 1986); joints that
/// would leave their limits stop there. The search only goes downhill, so it may end in a local
/// minimum, which another start avoids.
///
/// # Errors
///
/// [`InverseError::NotFinite`] if an argument is not finite; [`InverseError::NotConverged`], with
/// the remaining distance, if the tip does not reach the target.
pub fn search<T: Real, const N: usize>(
    mechanism: &impl Kinematics<T, N>,
    target: &Vector3<T>,
    start: &SVector<T, N>,
    limits: &JointLimits<T, N>,
    options: &SearchOptions<T>,
) -> Result<SVector<T, N>, InverseError> {
    check_finite("a coordinate of the target", target.iter())?;
    check_finite("a position of the start", start.iter())?;
    check_finite("an option", [&options.tolerance, &options.damping])?;
    let mut damping = options.damping;
    let mut q = limits.clamp(start);
    let (tip, mut jacobian) = mechanism.kinematics(&q);
    let mut error = target - tip.position;
    check_finite("a coordinate of the way to the target", error.iter())?;
    for _ in 0..options.iterations {
        if length(&error) <= options.tolerance {
            return Ok(q);
        }
        let next = step(&linear(&jacobian), &error, damping, &q, limits);
        let (next_tip, next_jacobian) = mechanism.kinematics(&next);
        let remains = target - next_tip.position;
        if remains.norm_squared() < error.norm_squared() {
            (q, jacobian, error) = (next, next_jacobian, remains);
            damping = max(damping * real::<T>(0.5), options.damping);
        } else {
            damping *= real::<T>(4.0);
        }
    }
    let remains = length(&error);
    if remains <= options.tolerance {
        return Ok(q);
    }
    Err(InverseError::NotConverged {
        error: min(remains.to_f64(), f64::MAX),
        iterations: options.iterations,
    })
}

/// The posture after one step: joints that would leave their limits stop there, and the others go
/// the rest of the way.
fn step<T: Real, const N: usize>(
    jacobian: &SMatrix<T, 3, N>,
    error: &Vector3<T>,
    damping: T,
    q: &SVector<T, N>,
    limits: &JointLimits<T, N>,
) -> SVector<T, N> {
    let mut free = *jacobian;
    let mut rest = *error;
    let mut stopped = *q;
    let mut next = *q;
    // Each pass stops another joint, or is the last.
    for _ in 0..=N {
        let Some(step) = damped(&free, &rest, damping) else {
            break;
        };
        next = stopped + step;
        let within = limits.clamp(&next);
        if within == next {
            break;
        }
        let (columns, _) = free.as_mut_slice().as_chunks_mut::<3>();
        let columns = columns.iter_mut().zip(stopped.iter_mut());
        for ((column, stopped), (&next, &within)) in columns.zip(next.iter().zip(within.iter())) {
            if next != within {
                rest -= Vector3::from(*column) * (within - *stopped);
                *column = [T::zero(); 3];
                *stopped = within;
            }
        }
    }
    limits.clamp(&next)
}

fn length<T: Real>(vector: &Vector3<T>) -> T {
    sqrt(vector.norm_squared())
}
