use nalgebra::Vector3;

use crate::Real;

/// A symmetric 3×3 matrix by its upper triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Symmetric<T: Real> {
    xx: T,
    xy: T,
    xz: T,
    yy: T,
    yz: T,
    zz: T,
}

impl<T: Real> Symmetric<T> {
    #[inline(always)]
    pub(super) fn zero() -> Self {
        let zero = T::zero();
        Self {
            xx: zero,
            xy: zero,
            xz: zero,
            yy: zero,
            yz: zero,
            zz: zero,
        }
    }

    /// Adds the inertia of a unit mass at the end of the arm: `|r|² I - r rᵀ`.
    #[inline(always)]
    pub(super) fn add_point(&mut self, arm: &Vector3<T>) {
        let (xx, yy, zz) = (arm.x * arm.x, arm.y * arm.y, arm.z * arm.z);
        self.xx += yy + zz;
        self.yy += xx + zz;
        self.zz += xx + yy;
        self.xy -= arm.x * arm.y;
        self.xz -= arm.x * arm.z;
        self.yz -= arm.y * arm.z;
    }

    #[inline(always)]
    pub(super) fn trace(&self) -> T {
        self.xx + self.yy + self.zz
    }

    /// The matrix of cofactors, and the determinant.
    #[inline(always)]
    pub(super) fn adjugate(&self) -> (Self, T) {
        let adjugate = Self {
            xx: self.yy * self.zz - self.yz * self.yz,
            xy: self.xz * self.yz - self.xy * self.zz,
            xz: self.xy * self.yz - self.xz * self.yy,
            yy: self.xx * self.zz - self.xz * self.xz,
            yz: self.xy * self.xz - self.xx * self.yz,
            zz: self.xx * self.yy - self.xy * self.xy,
        };
        let determinant = self.xx * adjugate.xx + self.xy * adjugate.xy + self.xz * adjugate.xz;
        (adjugate, determinant)
    }

    #[inline(always)]
    pub(super) fn scaled(&self, factor: T) -> Self {
        Self {
            xx: self.xx * factor,
            xy: self.xy * factor,
            xz: self.xz * factor,
            yy: self.yy * factor,
            yz: self.yz * factor,
            zz: self.zz * factor,
        }
    }

    #[inline(always)]
    pub(super) fn times(&self, vector: &Vector3<T>) -> Vector3<T> {
        let (x, y, z) = (vector.x, vector.y, vector.z);
        Vector3::new(
            self.xx * x + self.xy * y + self.xz * z,
            self.xy * x + self.yy * y + self.yz * z,
            self.xz * x + self.yz * y + self.zz * z,
        )
    }
}
