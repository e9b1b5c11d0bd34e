use nalgebra::Vector3;

use crate::math::{max, sqrt};
use crate::number::{NumberError, not_negative, positive};

/// The simulated surface between two bodies that touch: a spring and a damper along the normal, and
/// a spring and a damper across it that stick up to Coulomb's limit.
///
/// The spring across is anchored at the point where the bodies first touched, and slides when the
/// limit is reached (Cundall and Strack 1979). So a body that is held does not creep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimSurface {
    /// The stiffness along the normal, N/m.
    pub stiffness: f64,
    /// The damping along the normal, N s/m.
    pub damping: f64,
    /// The stiffness across the normal, N/m.
    pub shear_stiffness: f64,
    /// The damping across the normal, N s/m.
    pub shear_damping: f64,
    /// The coefficient of friction.
    pub friction: f64,
}

/// The state of the contact between two simulated bodies in the last update: whether they touch,
/// and with which force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimContact {
    /// True if the bodies touch.
    pub is_touching: bool,
    /// True if the bodies touch and friction is at its limit.
    pub is_sliding: bool,
    /// The point of contact in the palm, m.
    pub point: Vector3<f64>,
    /// The force on the first body, the tip, N.
    pub force: Vector3<f64>,
    /// The part of that force along the normal of the surface, N; not negative.
    pub pressing: f64,
    shear: Vector3<f64>,
}

/// The overlap of two bodies, seen by the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Overlap {
    /// The depth of the overlap, m; not above zero where the bodies do not touch.
    pub(super) depth: f64,
    /// The unit vector into the first.
    pub(super) normal: Vector3<f64>,
    /// In the middle of the overlap.
    pub(super) point: Vector3<f64>,
}

impl SimSurface {
    pub(super) fn check(&self) -> Result<(), NumberError> {
        positive("the stiffness of a contact, N/m", self.stiffness)?;
        not_negative("the damping of a contact, N s/m", self.damping)?;
        positive(
            "the shear stiffness of a contact, N/m",
            self.shear_stiffness,
        )?;
        not_negative("the shear damping of a contact, N s/m", self.shear_damping)?;
        not_negative("the friction of a contact", self.friction)
    }
}

impl SimContact {
    pub(super) fn none() -> Self {
        Self {
            is_touching: false,
            is_sliding: false,
            point: Vector3::zeros(),
            force: Vector3::zeros(),
            pressing: 0.0,
            shear: Vector3::zeros(),
        }
    }

    /// The force on the first body in an update of `dt` seconds; `velocity` is the first body's
    /// against the second's at the point of contact, m/s.
    pub(super) fn update(
        &mut self,
        surface: &SimSurface,
        overlap: &Overlap,
        velocity: &Vector3<f64>,
        dt: f64,
    ) -> Vector3<f64> {
        if overlap.depth <= 0.0 {
            *self = Self::none();
            return self.force;
        }
        let normal = &overlap.normal;
        let leaving = velocity.dot(normal);
        let across = velocity - normal * leaving;
        let pressing = max(
            surface.stiffness * overlap.depth - surface.damping * leaving,
            0.0,
        );
        // The anchor was made before these positions were reached with this velocity. It turns with
        // the surface and keeps its length, so that rolling does not wear it off.
        let mut shear = self.shear - normal * normal.dot(&self.shear);
        let length = sqrt(shear.norm_squared());
        if length > 0.0 {
            shear *= sqrt(self.shear.norm_squared()) / length;
        }
        if self.is_touching {
            shear += across * dt;
        }
        let mut friction = shear * -surface.shear_stiffness - across * surface.shear_damping;
        let wanted = sqrt(friction.norm_squared());
        let limit = surface.friction * pressing;
        self.is_sliding = wanted > limit;
        if self.is_sliding {
            friction *= limit / wanted;
            shear = friction / -surface.shear_stiffness;
        }
        self.is_touching = true;
        self.shear = shear;
        self.point = overlap.point;
        self.pressing = pressing;
        self.force = normal * pressing + friction;
        self.force
    }
}
