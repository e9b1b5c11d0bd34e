use nalgebra::{Matrix6, Vector3, Vector6};

use super::{GraspError, Twist, Wrench, off};
use crate::Requirement;
use crate::math::{abs, max, sqrt};
use crate::number::finite;

/// The stiffness or the damping of an object in six axes: along x, y, z and then about x, y, z. A
/// stiffness has entries in N/m, N/rad, N m/m and N m/rad; a damping has those units times s.
///
/// The matrix is always symmetric and has no negative eigenvalue. So a spring with it stores energy
/// in every direction, and a damper takes energy in every direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpatialGain {
    matrix: Matrix6<f64>,
}

impl SpatialGain {
    /// Makes a gain from its 6×6 matrix, which must be symmetric without negative eigenvalues,
    /// except for rounding. The result is exactly symmetric.
    ///
    /// # Errors
    /// [`NotSymmetric`](GraspError::NotSymmetric) if the matrix is not symmetric,
    /// [`Number`](GraspError::Number) if an entry is not finite, or if the matrix has a negative eigenvalue: then the
    /// number is the pivot of an axis in the factors L D Lᵀ.
    pub fn new(matrix: &Matrix6<f64>) -> Result<Self, GraspError> {
        let tolerance = f64::EPSILON * 256.0;
        for row in 0..6 {
            for column in 0..6 {
                let (value, mirrored) = (matrix[(row, column)], matrix[(column, row)]);
                finite("a gain of the object", value)?;
                // Products of roots, not roots of products, which overflow.
                let scale = sqrt(matrix[(row, row)]) * sqrt(matrix[(column, column)]);
                let size = max(max(abs(value), abs(mirrored)), scale);
                if abs(value - mirrored) > size * tolerance {
                    return Err(GraspError::NotSymmetric {
                        row,
                        column,
                        value,
                        mirrored,
                    });
                }
            }
        }
        let half = 0.5;
        let matrix = matrix.map(|gain| gain * half) + matrix.transpose().map(|gain| gain * half);
        factorize(&matrix, tolerance)?;
        Ok(Self { matrix })
    }

    /// Makes a gain whose axes do not influence each other: `gains` for x, y, z and then for the
    /// rotations about them.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if a gain is not finite or negative.
    pub fn diagonal(gains: [f64; 6]) -> Result<Self, GraspError> {
        Self::new(&Matrix6::from_diagonal(&Vector6::from(gains)))
    }

    /// Returns a gain of zero, which yields no wrench.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            matrix: Matrix6::zeros(),
        }
    }

    /// Returns the 6×6 matrix of the gain: rows and columns for x, y, z and then the rotations
    /// about them.
    #[must_use]
    pub fn matrix(&self) -> &Matrix6<f64> {
        &self.matrix
    }

    /// Returns the product of the gain and `twist`: the wrench that a displacement causes (for a
    /// stiffness) or that a velocity causes (for a damping). Both are about the same point.
    #[inline]
    #[must_use]
    pub fn times(&self, twist: &Twist) -> Wrench {
        let mut wrench = Wrench::zero();
        let (columns, _) = self.matrix.as_slice().as_chunks::<6>();
        let axes = twist.linear.iter().chain(twist.angular.iter());
        for (&[x, y, z, a, b, c], &along) in columns.iter().zip(axes) {
            wrench.force += Vector3::new(x * along, y * along, z * along);
            wrench.moment += Vector3::new(a * along, b * along, c * along);
        }
        wrench
    }
}

/// The pivots, as errors name them.
const AXES: [&str; 6] = [
    "the gain along x that the other axes leave",
    "the gain along y that the other axes leave",
    "the gain along z that the other axes leave",
    "the gain about x that the other axes leave",
    "the gain about y that the other axes leave",
    "the gain about z that the other axes leave",
];

/// Factors into L D Lᵀ, in units that make the diagonal one so that metres and radians compare, and
/// with the greatest pivot first, so that a singular matrix does not divide by its rounding.
fn factorize(matrix: &Matrix6<f64>, tolerance: f64) -> Result<(), GraspError> {
    let negative = |axis: usize, pivot: f64| {
        let what = AXES.get(axis).copied().unwrap_or_default();
        off(what, pivot, Requirement::AtLeast(0.0))
    };
    let mut roots = [0.0; 6];
    for (axis, root) in roots.iter_mut().enumerate() {
        let diagonal = matrix[(axis, axis)];
        if diagonal < 0.0 {
            return Err(negative(axis, diagonal));
        }
        *root = sqrt(diagonal);
        if *root == 0.0 {
            let greatest = matrix.column(axis).amax();
            if greatest > 0.0 {
                return Err(negative(axis, -greatest));
            }
        }
    }
    let over = |value: f64, root: f64| {
        if root > 0.0 { value / root } else { 0.0 }
    };
    let mut rest = Matrix6::from_fn(|i, j| over(over(matrix[(i, j)], roots[i]), roots[j]));
    for row in 0..6 {
        for column in 0..row {
            let excess = abs(rest[(row, column)]) - 1.0;
            if excess > tolerance {
                // A negative minor of these two axes.
                let root = roots[row];
                return Err(negative(row, -excess * root * root));
            }
        }
    }
    let mut left = [true; 6];
    loop {
        let mut pivot = None;
        for axis in (0..6).filter(|&axis| left[axis]) {
            let diagonal = rest[(axis, axis)];
            if pivot.is_none_or(|(_, greatest)| diagonal > greatest) {
                pivot = Some((axis, diagonal));
            }
        }
        let Some((axis, pivot)) = pivot else {
            return Ok(());
        };
        let positive = pivot > tolerance;
        if !positive {
            break;
        }
        let Some(place) = left.get_mut(axis) else {
            return Ok(());
        };
        *place = false;
        for i in (0..6).filter(|&i| left[i]) {
            let factor = rest[(i, axis)] / pivot;
            for j in (0..6).filter(|&j| left[j]) {
                let taken = factor * rest[(axis, j)];
                rest[(i, j)] -= taken;
            }
        }
    }
    // No pivot is left: what is not zero has a negative eigenvalue.
    for i in (0..6).filter(|&i| left[i]) {
        for j in (0..6).filter(|&j| left[j]) {
            let Some(&entry) = rest.get((i, j)) else {
                continue;
            };
            let value = if i == j { -entry } else { abs(entry) };
            // Also what overflowed on the way.
            let vanishes = value <= tolerance;
            if !vanishes {
                return Err(negative(i, -value * roots[i] * roots[i]));
            }
        }
    }
    Ok(())
}
