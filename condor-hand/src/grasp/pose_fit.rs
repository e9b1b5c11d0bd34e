use nalgebra::Vector3;

use super::contacts::{check, check_about, share, sum};
use super::quaternion::Rotation;
use super::{Contacts, GraspError, Twist, off, quantity, too_few, too_large};
use crate::Requirement;
use crate::math::{abs, is_finite, sqrt};

/// Newton's steps to the greatest eigenvalue: two or three for a rigid object, more only where two
/// eigenvalues nearly meet.
const STEPS: usize = 60;

/// Steps that bring the rotation to full precision.
const POLISHING: usize = 3;

impl<const M: usize> Contacts<M> {
    /// Returns the rigid motion that takes the contacts to the positions `desired` (m). If no rigid motion does so
    /// exactly, because the tips have slipped, it is the one with the least squares of errors.
    ///
    /// The rotation may be up to half a turn. The linear part of the result is the motion of the object's point at
    /// `about` (m).
    ///
    /// The rotation is the eigenvector of the greatest eigenvalue of a symmetric 4×4 matrix (Horn, "Closed-form
    /// solution of absolute orientation using unit quaternions", 1987). The eigenvalue comes from Newton's method on
    /// the characteristic polynomial, from above (Theobald, 2005), the vector from cofactors, and its last digits from
    /// small rotations of what remains: for a rigid object the error is some units of rounding.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) below three contacts; if the desired points lie on a line or are otherwise no
    /// image of the contacts; if a point is not finite, or if the result exceeds the range of the type.
    pub fn rigid_motion(
        &self,
        desired: &[Vector3<f64>; M],
        about: &Vector3<f64>,
    ) -> Result<Twist, GraspError> {
        if M < 3 {
            return Err(too_few(M, 3.0));
        }
        check(desired, quantity::DESIRED_TIP)?;
        check_about(about)?;
        let center = sum(desired) * share::<M>();
        let images = desired.map(|point| point - center);
        let mut rotation = self.fit(&images)?;
        let done = f64::EPSILON * f64::EPSILON;
        for _ in 0..POLISHING {
            let back = rotation.matrix().transpose();
            let mut moment = Vector3::zeros();
            for (arm, image) in self.arms().iter().zip(&images) {
                moment += arm.cross(&(back * image));
            }
            let half = self.turn(&moment) * 0.5;
            rotation = rotation.after_small(&half);
            if half.norm_squared() <= done {
                break;
            }
        }
        let lever = self.centroid() - about;
        let twist = Twist {
            linear: center - about - rotation.matrix() * lever,
            angular: rotation.vector(),
        };
        if twist.is_finite() {
            return Ok(twist);
        }
        Err(too_large(quantity::DESIRED_TIP))
    }

    /// The rotation that takes the arms to the images best.
    fn fit(&self, images: &[Vector3<f64>; M]) -> Result<Rotation, GraspError> {
        // In units of the mean square size no power overflows, and the greatest eigenvalue is at
        // most one.
        let mut size = self.trace() * 0.5;
        for image in images {
            size += image.norm_squared();
        }
        size *= 0.5;
        let unit = 1.0 / size;
        if !(unit > 0.0 && is_finite(unit)) {
            return Err(too_large(quantity::DESIRED_TIP));
        }
        let [mut x, mut y, mut z] = [Vector3::zeros(); 3];
        for (arm, image) in self.arms().iter().zip(images) {
            let image = image * unit;
            x += image * arm.x;
            y += image * arm.y;
            z += image * arm.z;
        }
        let horn = [
            [x.x + y.y + z.z, y.z - z.y, z.x - x.z, x.y - y.x],
            [y.z - z.y, x.x - y.y - z.z, x.y + y.x, z.x + x.z],
            [z.x - x.z, x.y + y.x, y.y - x.x - z.z, y.z + z.y],
            [x.y - y.x, z.x + x.z, y.z + z.y, z.z - x.x - y.y],
        ];
        let (_, product) = adjugate(&horn);
        let squares = x.norm_squared() + y.norm_squared() + z.norm_squared();
        let greatest = greatest_root(-(squares + squares), x.dot(&y.cross(&z)) * -8.0, product);
        let mut shifted = horn;
        for (row, line) in shifted.iter_mut().enumerate() {
            if let Some(diagonal) = line.get_mut(row) {
                *diagonal -= greatest;
            }
        }
        // Every row of cofactors is the eigenvector times its component: the longest is exact best.
        let (rows, _) = adjugate(&shifted);
        let mut best = [0.0; 4];
        let mut trace = 0.0;
        let mut most = 0.0;
        for (index, row) in rows.iter().enumerate() {
            let size = row.get(index).map_or(0.0, |diagonal| abs(*diagonal));
            trace += size;
            if size > most {
                (most, best) = (size, *row);
            }
        }
        // A double root is found to the square root of rounding only.
        let least = sqrt(f64::EPSILON) * 64.0;
        if trace > least {
            let [w, x, y, z] = best;
            return Ok(Rotation::normalized(w, Vector3::new(x, y, z)));
        }
        let what = "the separation of the fingertips, which is 0 at one point and on a line,";
        Err(off(what, trace, Requirement::Above(least)))
    }
}

/// The greatest root of `s⁴ + c2 s² + c1 s + c0`, whose roots are real and at most one.
fn greatest_root(c2: f64, c1: f64, c0: f64) -> f64 {
    let mut root = 1.0;
    for _ in 0..STEPS {
        let square = root * root;
        let value = (square + c2) * square + c1 * root + c0;
        let slope = (4.0 * square + c2 + c2) * root + c1;
        // Above the greatest root both are positive; what is not, is rounding.
        if !(value > 0.0 && slope > 0.0) {
            break;
        }
        let step = value / slope;
        root -= step;
        if step <= f64::EPSILON {
            break;
        }
    }
    root
}

/// The cofactors, transposed, and the determinant of a 4×4 matrix, by its minors of two rows.
fn adjugate(rows: &[[f64; 4]; 4]) -> ([[f64; 4]; 4], f64) {
    let [
        [a00, a01, a02, a03],
        [a10, a11, a12, a13],
        [a20, a21, a22, a23],
        [a30, a31, a32, a33],
    ] = *rows;
    let upper01 = a00 * a11 - a10 * a01;
    let upper02 = a00 * a12 - a10 * a02;
    let upper03 = a00 * a13 - a10 * a03;
    let upper12 = a01 * a12 - a11 * a02;
    let upper13 = a01 * a13 - a11 * a03;
    let upper23 = a02 * a13 - a12 * a03;
    let lower01 = a20 * a31 - a30 * a21;
    let lower02 = a20 * a32 - a30 * a22;
    let lower03 = a20 * a33 - a30 * a23;
    let lower12 = a21 * a32 - a31 * a22;
    let lower13 = a21 * a33 - a31 * a23;
    let lower23 = a22 * a33 - a32 * a23;
    let determinant = upper01 * lower23 - upper02 * lower13 + upper03 * lower12 + upper12 * lower03
        - upper13 * lower02
        + upper23 * lower01;
    let adjugate = [
        [
            a11 * lower23 - a12 * lower13 + a13 * lower12,
            a02 * lower13 - a01 * lower23 - a03 * lower12,
            a31 * upper23 - a32 * upper13 + a33 * upper12,
            a22 * upper13 - a21 * upper23 - a23 * upper12,
        ],
        [
            a12 * lower03 - a10 * lower23 - a13 * lower02,
            a00 * lower23 - a02 * lower03 + a03 * lower02,
            a32 * upper03 - a30 * upper23 - a33 * upper02,
            a20 * upper23 - a22 * upper03 + a23 * upper02,
        ],
        [
            a10 * lower13 - a11 * lower03 + a13 * lower01,
            a01 * lower03 - a00 * lower13 - a03 * lower01,
            a30 * upper13 - a31 * upper03 + a33 * upper01,
            a21 * upper03 - a20 * upper13 - a23 * upper01,
        ],
        [
            a11 * lower02 - a10 * lower12 - a12 * lower01,
            a00 * lower12 - a01 * lower02 + a02 * lower01,
            a31 * upper02 - a30 * upper12 - a32 * upper01,
            a20 * upper12 - a21 * upper02 + a22 * upper01,
        ],
    ];
    (adjugate, determinant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cofactors_invert() {
        let rows = [
            [2.0, -1.0, 0.5, 3.0],
            [0.25, 4.0, 1.0, -2.0],
            [1.0, 0.0, -3.0, 0.5],
            [-1.5, 2.0, 1.0, 1.0],
        ];
        let (adjugate, determinant) = adjugate(&rows);
        for (i, row) in adjugate.iter().enumerate() {
            for j in 0..4 {
                let product: f64 = row.iter().zip(&rows).map(|(a, b)| a * b[j]).sum();
                let expected = if i == j { determinant } else { 0.0 };
                assert!((product - expected).abs() < 1e-12, "{i} {j}");
            }
        }
        assert!(determinant.abs() > 1.0);
    }

    #[test]
    fn the_greatest_of_real_roots_is_found_from_above() {
        // (s - 0.9) (s + 0.2) (s + 0.3) (s + 0.4)
        let (c2, c1, c0) = (-0.55, -0.21, -0.0216);
        assert!((greatest_root(c2, c1, c0) - 0.9).abs() < 1e-15);
    }
}
