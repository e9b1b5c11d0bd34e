use nalgebra::{SMatrix, SVector};

use crate::math::is_finite;

/// The factors `L D Lᵀ` of a symmetric positive definite matrix, for solving linear systems with
/// it. L is a lower triangular matrix with ones on its diagonal, and D is diagonal, so no square
/// roots are needed: Golub and Van Loan, *Matrix Computations*, 4th ed., 4.1.2.
#[derive(Clone, Copy, Debug)]
pub struct Ldl<const N: usize> {
    /// L below the diagonal, and the reciprocals of D on it; what is above is not used.
    factors: SMatrix<f64, N, N>,
    /// The number of rows that were factored.
    size: usize,
}

impl<const N: usize> Ldl<N> {
    /// Factors a symmetric `matrix`, of which only the lower triangle is read. Returns `None` if
    /// the matrix is not positive definite.
    #[inline(always)]
    #[must_use]
    pub fn new(matrix: &SMatrix<f64, N, N>) -> Option<Self> {
        Self::leading(matrix, N)
    }

    /// Factors the first `size` rows and columns of a matrix, like [`new`](Self::new); the others do not count.
    #[inline(always)]
    #[must_use]
    pub fn leading(matrix: &SMatrix<f64, N, N>, size: usize) -> Option<Self> {
        let mut factors = *matrix;
        let size = size.min(N);
        for j in 0..size {
            let mut pivot = *factors.get((j, j))?;
            for k in 0..j {
                // Until here, the entries left of the diagonal are those of L D.
                let scaled = *factors.get((j, k))?;
                let entry = scaled * *factors.get((k, k))?;
                pivot -= scaled * entry;
                *factors.get_mut((j, k))? = entry;
            }
            let reciprocal = 1.0 / pivot;
            // No order for a NaN, which is not positive either.
            if !(pivot > 0.0 && is_finite(pivot) && is_finite(reciprocal)) {
                return None;
            }
            *factors.get_mut((j, j))? = reciprocal;
            for i in j + 1..size {
                for k in 0..j {
                    let known = *factors.get((i, k))? * *factors.get((j, k))?;
                    *factors.get_mut((i, j))? -= known;
                }
            }
        }
        Some(Self { factors, size })
    }

    /// Returns the solution x of the linear system `matrix x = right`, with the matrix that was
    /// factored. x is not finite if the exact solution is not. Beyond the rows that were factored it is `right`.
    #[inline(always)]
    #[must_use]
    pub fn solve(&self, right: &SVector<f64, N>) -> SVector<f64, N> {
        let mut x = *right;
        for i in 0..self.size {
            for k in 0..i {
                self.eliminate(&mut x, i, (i, k), k);
            }
        }
        for i in (0..self.size).rev() {
            if let (Some(entry), Some(&reciprocal)) = (x.get_mut(i), self.factors.get((i, i))) {
                *entry *= reciprocal;
            }
            for k in i + 1..self.size {
                self.eliminate(&mut x, i, (k, i), k);
            }
        }
        x
    }

    /// Takes a factor times `x[known]` from `x[row]`.
    #[inline(always)]
    fn eliminate(&self, x: &mut SVector<f64, N>, row: usize, factor: (usize, usize), known: usize) {
        let taken = match (self.factors.get(factor), x.get(known)) {
            (Some(&factor), Some(&known)) => factor * known,
            _ => return,
        };
        if let Some(entry) = x.get_mut(row) {
            *entry -= taken;
        }
    }
}
