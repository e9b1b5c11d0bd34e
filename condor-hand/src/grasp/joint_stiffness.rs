use nalgebra::{SMatrix, Vector3};

use super::contacts::check_list;
use super::{Contacts, GraspError, SpatialGain, quantity};
use crate::Real;
use crate::kinematics::Jacobian;

impl<T: Real, const M: usize> Contacts<T, M> {
    /// Returns a matrix for each finger that says how its joints move the object. `jacobians` are
    /// those of the fingertips; the linear motion in the result is that of the object's point at
    /// `about` (m).
    ///
    /// A matrix has six rows (m/rad, rad/rad) and a column for each joint: `(G⁺)ᵀ J`.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if a number or the point is not finite, or if the result exceeds
    /// the range of the type.
    pub fn object_jacobians<const N: usize>(
        &self,
        jacobians: &[Jacobian<T, N>; M],
        about: &Vector3<T>,
    ) -> Result<[Jacobian<T, N>; M], GraspError> {
        for (finger, jacobian) in jacobians.iter().enumerate() {
            check_list(finger, quantity::JACOBIAN, jacobian.as_slice())?;
        }
        let mut motions = [Jacobian::<T, N>::zeros(); M];
        for (finger, (motion, jacobian)) in motions.iter_mut().zip(jacobians).enumerate() {
            for (mut column, joint) in motion.column_iter_mut().zip(jacobian.column_iter()) {
                let mut tips = [Vector3::zeros(); M];
                if let Some(tip) = tips.get_mut(finger) {
                    *tip = joint.fixed_rows::<3>(0).into_owned();
                }
                let twist = self.object_motion(&tips, about)?;
                column.fixed_rows_mut::<3>(0).copy_from(&twist.linear);
                column.fixed_rows_mut::<3>(3).copy_from(&twist.angular);
            }
        }
        Ok(motions)
    }
}

impl<T: Real> SpatialGain<T> {
    /// Returns the joint stiffness (N m/rad) that makes the object have this stiffness; for a
    /// damping, the joint damping (N m s/rad).
    ///
    /// It is `Hᵀ K H` with the [object's Jacobians](Contacts::object_jacobians) H. Block `[i][j]`
    /// has the torques of finger i that displacements of the joints of finger j cause; its
    /// transpose is block `[j][i]`.
    #[must_use]
    pub fn of_joints<const M: usize, const N: usize>(
        &self,
        object_jacobians: &[Jacobian<T, N>; M],
    ) -> [[SMatrix<T, N, N>; M]; M] {
        object_jacobians.map(|row| {
            let loads = row.transpose() * self.matrix();
            object_jacobians.map(|column| loads * column)
        })
    }
}
