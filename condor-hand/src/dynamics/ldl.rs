use nalgebra::{SMatrix, SVector};

use crate::Real;
use crate::math::is_finite;

/// The `x` of `a x = b` for a symmetric positive definite `a`, of which only the lower triangle is
/// read; `None` where it is not positive definite, or the answer is not finite.
///
/// `LDLᵀ` without square roots: Golub and Van Loan, *Matrix Computations*, 4th ed., §4.1.2.
pub(super) fn solve<T: Real, const N: usize>(
    a: &SMatrix<T, N, N>,
    b: &SVector<T, N>,
) -> Option<SVector<T, N>> {
    // The unit lower triangle; its diagonal holds the reciprocal pivots.
    let mut lower = *a;
    for j in 0..N {
        let mut pivot = *a.get((j, j))?;
        for k in 0..j {
            // Until here, the entries left of the diagonal are those of L D.
            let scaled = *lower.get((j, k))?;
            let entry = scaled * *lower.get((k, k))?;
            pivot -= scaled * entry;
            *lower.get_mut((j, k))? = entry;
        }
        // No order for a NaN, which is not positive either.
        if pivot > T::zero() {
            *lower.get_mut((j, j))? = T::one() / pivot;
        } else {
            return None;
        }
        for i in j + 1..N {
            for k in 0..j {
                let known = *lower.get((i, k))? * *lower.get((j, k))?;
                *lower.get_mut((i, j))? -= known;
            }
        }
    }
    let mut x = *b;
    for i in 0..N {
        for k in 0..i {
            let known = *lower.get((i, k))? * *x.get(k)?;
            *x.get_mut(i)? -= known;
        }
    }
    for i in (0..N).rev() {
        *x.get_mut(i)? *= *lower.get((i, i))?;
        for k in i + 1..N {
            let known = *lower.get((k, i))? * *x.get(k)?;
            *x.get_mut(i)? -= known;
        }
    }
    x.iter().all(|&x| is_finite(x)).then_some(x)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::solve;

    #[test]
    fn only_the_lower_triangle_counts() {
        let symmetric = Matrix3::new(4.0, -2.0, 1.0, -2.0, 5.0, 0.5, 1.0, 0.5, 3.0);
        let x = Vector3::new(1.0, -2.0, 0.25);
        let mut lower = symmetric;
        lower.fill_upper_triangle(f64::NAN, 1);
        let found = solve(&lower, &(symmetric * x)).unwrap();
        assert!((found - x).amax() < 1e-15, "{found}");
    }

    #[test]
    fn what_is_not_positive_definite_has_no_answer() {
        let b = Vector3::new(1.0, 1.0, 1.0);
        let singular = Matrix3::from_element(1.0);
        let indefinite = Matrix3::new(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        let no_number = Matrix3::from_diagonal(&Vector3::new(1.0, f64::NAN, 1.0));
        for a in [singular, indefinite, no_number] {
            assert_eq!(solve(&a, &b), None, "{a}");
        }
    }
}
