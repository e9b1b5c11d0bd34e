use nalgebra::{SMatrix, SVector};

use crate::math::{Real, is_finite};

/// A symmetric positive definite matrix as `L D Lᵀ`, L with ones on its diagonal: Golub and Van
/// Loan, Matrix Computations, 4.1.2. There are no square roots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ldl<T: Real, const N: usize> {
    lower: SMatrix<T, N, N>,
    diagonal: SVector<T, N>,
}

impl<T: Real, const N: usize> Ldl<T, N> {
    /// Factors a matrix, whose upper triangle is not looked at; `None` if it is not positive
    /// definite.
    #[must_use]
    pub fn new(matrix: &SMatrix<T, N, N>) -> Option<Self> {
        let mut lower = SMatrix::<T, N, N>::identity();
        let mut diagonal = SVector::<T, N>::zeros();
        for column in 0..N {
            let mut pivot = *matrix.get((column, column))?;
            for k in 0..column {
                let l = *lower.get((column, k))?;
                pivot -= l * l * *diagonal.get(k)?;
            }
            if !(pivot > T::zero() && is_finite(pivot)) {
                return None;
            }
            *diagonal.get_mut(column)? = pivot;
            for row in column + 1..N {
                let mut entry = *matrix.get((row, column))?;
                for k in 0..column {
                    entry -= *lower.get((row, k))? * *lower.get((column, k))? * *diagonal.get(k)?;
                }
                *lower.get_mut((row, column))? = entry / pivot;
            }
        }
        Some(Self { lower, diagonal })
    }

    /// The solution x of `matrix x = right`.
    #[must_use]
    pub fn solve(&self, right: &SVector<T, N>) -> SVector<T, N> {
        let mut x = *right;
        for row in 0..N {
            let mut sum = right.get(row).copied().unwrap_or_else(T::zero);
            for (&l, &known) in self.lower.row(row).iter().zip(&x).take(row) {
                sum -= l * known;
            }
            if let Some(entry) = x.get_mut(row) {
                *entry = sum;
            }
        }
        x.component_div_assign(&self.diagonal);
        for row in (0..N).rev() {
            let known = x.get(row).copied().unwrap_or_else(T::zero);
            for (entry, &l) in x.iter_mut().zip(self.lower.row(row).iter()).take(row) {
                *entry -= l * known;
            }
        }
        x
    }

    /// The diagonal of D: as many positive numbers as there are rows.
    #[must_use]
    pub fn diagonal(&self) -> &SVector<T, N> {
        &self.diagonal
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector4};

    use super::*;

    #[test]
    fn solves_what_is_positive_definite() {
        let root = Matrix4::new(
            1.0, 0.2, -0.5, 3.0, 0.0, 2.0, 0.7, -1.0, 0.3, 0.1, 1.5, 0.4, 0.9, -0.6, 0.8, 1.0,
        );
        let matrix = root * root.transpose();
        let right = Vector4::new(1.0, -2.0, 0.5, 4.0);
        let factors = Ldl::new(&matrix).unwrap();
        assert!((matrix * factors.solve(&right) - right).amax() < 1e-12);
        let product: f64 = factors.diagonal().iter().product();
        assert!((product - matrix.determinant()).abs() < 1e-10);
    }

    #[test]
    fn refuses_what_is_not() {
        assert!(Ldl::new(&Matrix4::<f64>::zeros()).is_none());
        let indefinite = Matrix4::from_diagonal(&Vector4::new(1.0, 2.0, -1e-9, 1.0));
        assert!(Ldl::new(&indefinite).is_none());
        assert!(Ldl::new(&Matrix4::from_element(f64::NAN)).is_none());
        assert!(Ldl::new(&Matrix4::from_element(f64::INFINITY)).is_none());
    }
}
