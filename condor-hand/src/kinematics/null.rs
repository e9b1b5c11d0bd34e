//! The direction in which joints move without moving the tip.

use nalgebra::{SMatrix, SVector, Vector3};

use crate::math::{is_finite, sqrt};

/// A combination of joint rates, and how it moves the tip.
#[derive(Clone, Copy)]
struct Combination<const N: usize> {
    rates: SVector<f64, N>,
    tip: Vector3<f64>,
    /// Still to be combined with others.
    open: bool,
}

/// The unit null vector of a linear Jacobian, over the joints that move; `None` where there is
/// none, or more than one.
///
/// Modified Gram-Schmidt with column pivoting (Golub and Van Loan, *Matrix Computations*, section
/// 5.4) that keeps the combination of joints of each column: what remains after the last pivot are
/// the null vectors. A pivot below √ε of the first counts as zero. With four joints the sign is
/// opposite to that of the 3 x 3 minors with alternating signs, and so does not jump; a planar finger
/// in front of its first axis has the same.
pub(super) fn null_direction<const N: usize>(
    jacobian: &SMatrix<f64, 3, N>,
    moving: &[bool; N],
) -> Option<SVector<f64, N>> {
    let mut columns = [Combination {
        rates: SVector::<f64, N>::zeros(),
        tip: Vector3::zeros(),
        open: false,
    }; N];
    let given = tips(jacobian).zip(moving);
    for ((joint, column), (tip, &open)) in columns.iter_mut().enumerate().zip(given) {
        column.tip = tip;
        column.open = open;
        if let Some(rate) = column.rates.get_mut(joint) {
            *rate = 1.0;
        }
    }

    let mut least = 0.0;
    for _ in 0..3 {
        let Some(pivot) = take_largest(&mut columns, least) else {
            break;
        };
        let square = pivot.tip.norm_squared();
        if least == 0.0 {
            least = square * f64::EPSILON;
        }
        for column in columns.iter_mut().filter(|column| column.open) {
            let share = column.tip.dot(&pivot.tip) / square;
            column.tip -= pivot.tip * share;
            column.rates -= pivot.rates * share;
        }
    }

    let mut open = columns.iter().filter(|column| column.open);
    let only = open.next()?;
    if open.next().is_some() {
        return None;
    }
    let length = sqrt(only.rates.norm_squared());
    let unit = only.rates / oriented(length, jacobian, moving, &columns);
    unit.iter().all(|&rate| is_finite(rate)).then_some(unit)
}

/// The motion of the tip with each joint.
fn tips<const N: usize>(jacobian: &SMatrix<f64, 3, N>) -> impl Iterator<Item = Vector3<f64>> + '_ {
    let (columns, _) = jacobian.as_slice().as_chunks::<3>();
    columns.iter().map(|&[x, y, z]| Vector3::new(x, y, z))
}

/// Closes the column that moves the tip most, if that is more than `least` (m², squared).
fn take_largest<const N: usize>(
    columns: &mut [Combination<N>; N],
    least: f64,
) -> Option<Combination<N>> {
    let mut largest: Option<&mut Combination<N>> = None;
    for column in columns.iter_mut().filter(|column| column.open) {
        let square = column.tip.norm_squared();
        let most = largest
            .as_ref()
            .map_or(least, |column| column.tip.norm_squared());
        if square > most {
            largest = Some(column);
        }
    }
    let largest = largest?;
    largest.open = false;
    Some(*largest)
}

/// `length` with the sign of the minor of the three columns that were taken, of four.
fn oriented<const N: usize>(
    length: f64,
    jacobian: &SMatrix<f64, 3, N>,
    moving: &[bool; N],
    columns: &[Combination<N>; N],
) -> f64 {
    let mut taken = [Vector3::zeros(); 3];
    let mut places = taken.iter_mut();
    let mut after = false;
    let mut odd = false;
    let present = tips(jacobian).zip(columns).zip(moving);
    for ((tip, column), _) in present.filter(|(_, moving)| **moving) {
        if column.open {
            after = true;
        } else if let Some(place) = places.next() {
            *place = tip;
            odd ^= !after;
        }
    }
    let [a, b, c] = taken;
    let minor = a.dot(&b.cross(&c));
    if (minor > 0.0) ^ odd { -length } else { length }
}
