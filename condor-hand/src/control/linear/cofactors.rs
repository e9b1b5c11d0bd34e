use nalgebra::{Matrix3, Vector3};

use crate::math::{Real, is_finite, real};

/// The cofactors of a symmetric 3x3 matrix, and with them its inverse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cofactors<T: Real = f64> {
    adjugate: Matrix3<T>,
    determinant: T,
    trace: T,
}

impl<T: Real> Cofactors<T> {
    /// The cofactors of a matrix, whose lower triangle is not looked at.
    #[inline]
    #[must_use]
    pub fn of(matrix: &Matrix3<T>) -> Self {
        let (xx, yy, zz) = (matrix.m11, matrix.m22, matrix.m33);
        let (xy, xz, yz) = (matrix.m12, matrix.m13, matrix.m23);
        let c11 = yy * zz - yz * yz;
        let c12 = xz * yz - xy * zz;
        let c13 = xy * yz - xz * yy;
        let c22 = xx * zz - xz * xz;
        let c23 = xy * xz - xx * yz;
        let c33 = xx * yy - xy * xy;
        Self {
            adjugate: Matrix3::new(c11, c12, c13, c12, c22, c23, c13, c23, c33),
            determinant: xx * c11 + xy * c12 + xz * c13,
            trace: xx + yy + zz,
        }
    }

    /// The determinant.
    #[inline]
    #[must_use]
    pub fn determinant(&self) -> T {
        self.determinant
    }

    /// The determinant over the cube of a third of the trace.
    ///
    /// For a positive definite matrix it is in 0..=1, by the inequality of the means of its
    /// eigenvalues: one if they are equal, nearly zero if one of them is nearly zero against the
    /// largest. Zero for a matrix without trace, or if the quotient is not finite.
    #[inline]
    #[must_use]
    pub fn conditioning(&self) -> T {
        let mean = self.trace / real(3.0);
        let quotient = self.determinant / (mean * mean * mean);
        if is_finite(quotient) {
            quotient
        } else {
            T::zero()
        }
    }

    /// The solution x of `matrix x = right`; `None` if the matrix is singular, or the solution
    /// not finite.
    #[inline]
    #[must_use]
    pub fn solve(&self, right: &Vector3<T>) -> Option<Vector3<T>> {
        let solution = self.adjugate * right / self.determinant;
        is_finite(solution.x + solution.y + solution.z).then_some(solution)
    }

    /// The inverse; `None` if the matrix is singular, or the inverse not finite.
    #[inline]
    #[must_use]
    pub fn inverse(&self) -> Option<Matrix3<T>> {
        let inverse = self.adjugate / self.determinant;
        inverse
            .iter()
            .all(|&entry| is_finite(entry))
            .then_some(inverse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_inverts() {
        let matrix = Matrix3::new(4.0_f64, 1.0, -2.0, 1.0, 5.0, 0.5, -2.0, 0.5, 3.0);
        let cofactors = Cofactors::of(&matrix);
        let unit = cofactors.inverse().unwrap() * matrix;
        assert!((unit - Matrix3::identity()).amax() < 1e-15);
        let right = Vector3::new(1.0, -2.0, 3.0);
        assert!((matrix * cofactors.solve(&right).unwrap() - right).amax() < 1e-14);
        assert!((cofactors.determinant() - matrix.determinant()).abs() < 1e-13);
    }

    #[test]
    fn conditioning_is_one_for_a_sphere_and_zero_for_a_line() {
        let sphere = Cofactors::of(&(Matrix3::identity() * 7.0_f64));
        assert!((sphere.conditioning() - 1.0).abs() < 1e-15);
        let line = Vector3::new(1.0, 2.0, -1.0);
        let flat = Cofactors::of(&(line * line.transpose()));
        assert_eq!(flat.conditioning(), 0.0);
        assert_eq!(Cofactors::of(&Matrix3::<f64>::zeros()).conditioning(), 0.0);
    }

    #[test]
    fn a_singular_matrix_has_no_inverse() {
        let flat = Cofactors::of(&Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 0.0)));
        assert_eq!(flat.inverse(), None);
        assert_eq!(flat.solve(&Vector3::new(1.0, 1.0, 1.0)), None);
        assert_eq!(
            Cofactors::of(&Matrix3::from_element(f64::NAN)).inverse(),
            None
        );
    }
}
