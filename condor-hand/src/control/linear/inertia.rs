use nalgebra::SMatrix;

use crate::math::{Real, abs, is_finite, max, real};

/// How many eigenvalues of a symmetric matrix are positive, zero and negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Inertia {
    /// Those above zero.
    pub positive: usize,
    /// Those that a tolerance does not tell from zero.
    pub zero: usize,
    /// Those below zero.
    pub negative: usize,
}

/// The signs of the eigenvalues of a symmetric matrix, whose upper triangle is not looked at.
///
/// They are those of the blocks that elimination leaves on the diagonal (Sylvester's law of
/// inertia), with the pivots of Bunch and Parlett, "Direct methods for solving symmetric indefinite
/// systems of linear equations", 1971. What is left below `tolerance` times the largest entry
/// counts as zero. `None` if an entry is not finite.
#[must_use]
pub fn inertia<T: Real, const N: usize>(
    matrix: &SMatrix<T, N, N>,
    tolerance: T,
) -> Option<Inertia> {
    let mut rest = Rest::new(matrix)?;
    let small = max(tolerance, T::zero());
    let mut inertia = Inertia::default();
    loop {
        let (diagonal, p) = rest.largest_diagonal();
        let (off, (i, j)) = rest.largest_off_diagonal();
        if max(diagonal, off) <= small {
            inertia.zero += rest.open();
            return Some(inertia);
        }
        // The bound of growth is the same for both kinds of pivots at (1 + sqrt(17)) / 8.
        if diagonal >= off * real(0.640_388_203_202_208) {
            if rest.at(p, p) > T::zero() {
                inertia.positive += 1;
            } else {
                inertia.negative += 1;
            }
            rest.eliminate_one(p);
        } else {
            // Its determinant is negative, because both its diagonal entries are small.
            inertia.positive += 1;
            inertia.negative += 1;
            rest.eliminate_two(i, j);
        }
    }
}

/// Whether no eigenvalue of a symmetric matrix is below zero by more than a tolerance, relative to
/// its largest entry; false if an entry is not finite.
#[must_use]
pub fn is_positive_semidefinite<T: Real, const N: usize>(
    matrix: &SMatrix<T, N, N>,
    tolerance: T,
) -> bool {
    inertia(matrix, tolerance).is_some_and(|inertia| inertia.negative == 0)
}

/// What elimination has left of a symmetric matrix.
struct Rest<T: Real, const N: usize> {
    matrix: SMatrix<T, N, N>,
    open: [bool; N],
}

impl<T: Real, const N: usize> Rest<T, N> {
    fn new(matrix: &SMatrix<T, N, N>) -> Option<Self> {
        let mut full = *matrix;
        full.fill_upper_triangle_with_lower_triangle();
        let largest = full
            .iter()
            .fold(T::zero(), |largest, &entry| max(abs(entry), largest));
        if !full.iter().all(|&entry| is_finite(entry)) {
            return None;
        }
        // Relative to the largest entry nothing overflows, and the tolerance is absolute.
        if largest > T::zero() {
            full /= largest;
        }
        Some(Self {
            matrix: full,
            open: [true; N],
        })
    }

    fn at(&self, row: usize, column: usize) -> T {
        self.matrix
            .get((row, column))
            .copied()
            .unwrap_or_else(T::zero)
    }

    fn rows(&self) -> impl Iterator<Item = usize> + use<T, N> {
        let open = self.open;
        (0..N).filter(move |&row| open.get(row) == Some(&true))
    }

    fn open(&self) -> usize {
        self.rows().count()
    }

    fn largest_diagonal(&self) -> (T, usize) {
        let mut largest = (T::zero(), 0);
        for row in self.rows() {
            let size = abs(self.at(row, row));
            if size > largest.0 {
                largest = (size, row);
            }
        }
        largest
    }

    fn largest_off_diagonal(&self) -> (T, (usize, usize)) {
        let mut largest = (T::zero(), (0, 0));
        for row in self.rows() {
            for column in self.rows().take_while(|&column| column < row) {
                let size = abs(self.at(row, column));
                if size > largest.0 {
                    largest = (size, (row, column));
                }
            }
        }
        largest
    }

    fn close(&mut self, row: usize) {
        if let Some(open) = self.open.get_mut(row) {
            *open = false;
        }
    }

    fn eliminate_one(&mut self, p: usize) {
        self.close(p);
        let pivot = self.at(p, p);
        self.subtract(|rest, row, column| rest.at(row, p) * rest.at(p, column) / pivot);
    }

    fn eliminate_two(&mut self, i: usize, j: usize) {
        self.close(i);
        self.close(j);
        let (ii, jj, ij) = (self.at(i, i), self.at(j, j), self.at(i, j));
        let determinant = ii * jj - ij * ij;
        self.subtract(|rest, row, column| {
            let (ri, rj) = (rest.at(row, i), rest.at(row, j));
            let (ci, cj) = (rest.at(i, column), rest.at(j, column));
            (ri * (jj * ci - ij * cj) + rj * (ii * cj - ij * ci)) / determinant
        });
    }

    /// Takes what a pivot explains out of the open rows; those of the pivot stay as they are.
    fn subtract(&mut self, part: impl Fn(&Self, usize, usize) -> T) {
        for row in self.rows() {
            for column in self.rows() {
                let left = self.at(row, column) - part(self, row, column);
                if let Some(entry) = self.matrix.get_mut((row, column)) {
                    *entry = left;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Matrix6, Vector6};
    use proptest::prelude::*;

    use super::*;

    fn counts(values: [f64; 6]) -> Inertia {
        Inertia {
            positive: values.iter().filter(|&&x| x > 0.0).count(),
            zero: values.iter().filter(|&&x| x == 0.0).count(),
            negative: values.iter().filter(|&&x| x < 0.0).count(),
        }
    }

    #[test]
    fn a_hyperbola_has_one_of_each() {
        let signs = inertia(&Matrix2::new(0.0, 1.0, 1.0, 0.0), 1e-12).unwrap();
        assert_eq!((signs.positive, signs.negative), (1, 1));
        assert!(!is_positive_semidefinite(
            &Matrix2::new(0.0, 1.0, 1.0, 0.0),
            1e-12
        ));
        assert!(!is_positive_semidefinite(
            &Matrix2::new(1.0, 2.0, 2.0, 1.0),
            1e-12
        ));
    }

    #[test]
    fn the_largest_numbers_do_not_overflow() {
        let matrix = Matrix2::new(-f64::MAX, f64::MAX, f64::MAX, f64::MAX);
        let signs = inertia(&matrix, -1.0).unwrap();
        assert_eq!((signs.positive, signs.negative), (1, 1));
    }

    #[test]
    fn zero_is_semidefinite_and_nan_is_nothing() {
        assert!(is_positive_semidefinite(&Matrix6::<f64>::zeros(), 1e-12));
        assert!(!is_positive_semidefinite(
            &Matrix6::from_element(f64::NAN),
            1e-12
        ));
    }

    proptest! {
        /// Sylvester: a congruence keeps the signs.
        #[test]
        fn signs_survive_a_congruence(
            signs in prop::array::uniform6(-1_i8..=1),
            sizes in prop::array::uniform6(0.1_f64..10.0),
            entries in prop::collection::vec(-0.3_f64..0.3, 36),
        ) {
            let mut values = [0.0; 6];
            for i in 0..6 {
                values[i] = f64::from(signs[i]) * sizes[i];
            }
            let change = Matrix6::identity() + Matrix6::from_row_slice(&entries);
            prop_assume!(change.determinant().abs() > 0.05);
            let matrix = change * Matrix6::from_diagonal(&Vector6::from(values)) * change.transpose();
            prop_assert_eq!(inertia(&matrix, 1e-12), Some(counts(values)));
        }
    }
}
