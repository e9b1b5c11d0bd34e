use nalgebra::Vector3;

/// A symmetric 3×3 matrix, such as an inertia; only the upper triangle is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Symmetric3 {
    /// Row x, column x.
    pub xx: f64,
    /// Row x, column y.
    pub xy: f64,
    /// Row x, column z.
    pub xz: f64,
    /// Row y, column y.
    pub yy: f64,
    /// Row y, column z.
    pub yz: f64,
    /// Row z, column z.
    pub zz: f64,
}

impl Symmetric3 {
    /// Returns the matrix in which all entries are zero.
    #[inline(always)]
    #[must_use]
    pub fn zero() -> Self {
        Self {
            xx: 0.0,
            xy: 0.0,
            xz: 0.0,
            yy: 0.0,
            yz: 0.0,
            zz: 0.0,
        }
    }

    /// Adds the inertia of a unit mass at the point `arm`, taken about the origin: `|r|² I - r rᵀ`
    /// with r = `arm`.
    #[inline(always)]
    pub fn add_point(&mut self, arm: &Vector3<f64>) {
        let (xx, yy, zz) = (arm.x * arm.x, arm.y * arm.y, arm.z * arm.z);
        self.xx += yy + zz;
        self.yy += xx + zz;
        self.zz += xx + yy;
        self.xy -= arm.x * arm.y;
        self.xz -= arm.x * arm.z;
        self.yz -= arm.y * arm.z;
    }

    /// Returns the trace of the matrix: the sum of its diagonal.
    #[inline(always)]
    #[must_use]
    pub fn trace(&self) -> f64 {
        self.xx + self.yy + self.zz
    }

    /// Returns the adjugate (the matrix of cofactors) and the determinant. The adjugate divided by
    /// the determinant is the inverse.
    #[inline(always)]
    #[must_use]
    pub fn adjugate(&self) -> (Self, f64) {
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

    /// Returns the matrix with all entries multiplied by `factor`.
    #[inline(always)]
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            xx: self.xx * factor,
            xy: self.xy * factor,
            xz: self.xz * factor,
            yy: self.yy * factor,
            yz: self.yz * factor,
            zz: self.zz * factor,
        }
    }

    /// Returns the product of the matrix and `vector`.
    #[inline(always)]
    #[must_use]
    pub fn times(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        let (x, y, z) = (vector.x, vector.y, vector.z);
        Vector3::new(
            self.xx * x + self.xy * y + self.xz * z,
            self.xy * x + self.yy * y + self.yz * z,
            self.xz * x + self.yz * y + self.zz * z,
        )
    }
}
