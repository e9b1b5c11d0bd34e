use crate::math::{Real, is_finite};

/// Solves a tridiagonal system of any size in place, by elimination without pivoting: Thomas's
/// algorithm, Golub and Van Loan, Matrix Computations, 4.3.6.
///
/// Row i is `lower[i] x[i-1] + diagonal[i] x[i] + upper[i] x[i+1] = right[i]`; the first of `lower`
/// and the last of `upper` are not used. The solution replaces `right`; `diagonal` is overwritten.
/// Elimination without pivoting is safe if the diagonal dominates, as in splines. Returns `None`,
/// with any content of `right`, if the lengths differ, a pivot is zero, or the solution is not
/// finite.
#[must_use]
pub fn solve_tridiagonal<T: Real>(
    lower: &[T],
    diagonal: &mut [T],
    upper: &[T],
    right: &mut [T],
) -> Option<()> {
    let rows = right.len();
    if lower.len() != rows || diagonal.len() != rows || upper.len() != rows {
        return None;
    }
    for row in 1..rows {
        let factor = *lower.get(row)? / *diagonal.get(row - 1)?;
        *diagonal.get_mut(row)? -= factor * *upper.get(row - 1)?;
        let above = *right.get(row - 1)?;
        *right.get_mut(row)? -= factor * above;
    }
    let mut below = T::zero();
    for row in (0..rows).rev() {
        // There is nothing right of the last column, whatever stands there.
        let coupling = if row + 1 == rows {
            T::zero()
        } else {
            *upper.get(row)?
        };
        let solution = (*right.get(row)? - coupling * below) / *diagonal.get(row)?;
        if !is_finite(solution) {
            return None;
        }
        *right.get_mut(row)? = solution;
        below = solution;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_a_spline() {
        let lower = [f64::NAN, 1.0, 0.5, 1.0, 2.0];
        let upper = [2.0, 1.0, 1.0, 0.25, f64::NAN];
        let diagonal = [5.0, 4.0, 3.0, 4.0, 6.0];
        let right = [1.0, -2.0, 3.0, 0.0, 7.0];
        let (mut d, mut x) = (diagonal, right);
        solve_tridiagonal(&lower, &mut d, &upper, &mut x).unwrap();
        for row in 0..5 {
            let mut product = diagonal[row] * x[row];
            if row > 0 {
                product += lower[row] * x[row - 1];
            }
            if row < 4 {
                product += upper[row] * x[row + 1];
            }
            assert!((product - right[row]).abs() < 1e-14);
        }
    }

    #[test]
    fn refuses_a_singular_system_and_unequal_lengths() {
        let (zeros, ones) = ([0.0; 3], [1.0; 3]);
        let (mut d, mut x) = (zeros, ones);
        assert_eq!(solve_tridiagonal(&ones, &mut d, &ones, &mut x), None);
        let (mut d, mut x) = ([1.0; 2], ones);
        assert_eq!(solve_tridiagonal(&ones, &mut d, &ones, &mut x), None);
        assert_eq!(
            solve_tridiagonal::<f64>(&[], &mut [], &[], &mut []),
            Some(())
        );
    }
}
