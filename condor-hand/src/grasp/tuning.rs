use nalgebra::Vector3;

use super::contacts::{check_about, check_wrench};
use super::limits::check_limits;
use super::{
    ContactFriction, Contacts, GraspError, Normals, SpatialGain, Squeeze, TorqueLimits, Twist,
    Wrench,
};
use crate::number::{self, not_negative};

/// The surface of the object that the fingers touch. Only the friction margins depend on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TuningSurface<const M: usize> {
    /// A surface with these normals at the tips, while the object is at its desired place. They
    /// turn with the object.
    Normals(Normals<M>),
    /// A ball with its centre here (m) while it is where it is desired. The centre moves with it.
    Ball(Vector3<f64>),
}

/// The gains that keep the posture of a finger: they act on joint motions that do not move the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posture {
    /// The stiffness towards the desired posture, N m/rad.
    pub stiffness: f64,
    /// The damping of the rates of the joints, N m s/rad.
    pub damping: f64,
}

/// The parameters of a [grasp law](super::GraspStiffness), which may change while it holds an
/// object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraspTuning<const M: usize, const N: usize> {
    /// The stiffness of the object, about its middle in the axes of the palm.
    pub stiffness: SpatialGain,
    /// The damping of the object, about its middle in the axes of the palm.
    pub damping: SpatialGain,
    /// The desired place of the middle of the object in the palm, m. The stiffness and all wrenches are
    /// about the middle, wherever it is.
    pub center: Vector3<f64>,
    /// A further wrench on the object, about its middle, such as that which bears its weight.
    pub feed_forward: Wrench,
    /// The squeeze, by which the fingers press on the object.
    pub squeeze: Squeeze<M>,
    /// The surface of the object.
    pub surface: TuningSurface<M>,
    /// The friction, which determines when fingers slip.
    pub friction: ContactFriction,
    /// The gains that keep the joints where the tips leave them free.
    pub posture: Posture,
    /// The limits of the torques of each finger's joints.
    pub limits: [TorqueLimits<N>; M],
}

impl<const M: usize, const N: usize> GraspTuning<M, N> {
    /// Refuses what the types of the fields let pass.
    pub(super) fn check(&self) -> Result<(), GraspError> {
        check_wrench(&self.feed_forward)?;
        check_about(&self.center)?;
        if let TuningSurface::Ball(center) = &self.surface {
            for &coordinate in center {
                number::finite("a coordinate of the centre of the ball, m,", coordinate)?;
            }
        }
        not_negative(
            "the stiffness of the posture, N m/rad,",
            self.posture.stiffness,
        )?;
        not_negative(
            "the damping of the posture, N m s/rad,",
            self.posture.damping,
        )?;
        Ok(check_limits(&self.limits)?)
    }

    /// The normals at the contacts of an object that is this far from where it is desired.
    pub(super) fn normals(
        &self,
        contacts: &Contacts<M>,
        deviation: &Twist,
    ) -> Result<Normals<M>, GraspError> {
        let back = super::quaternion::Rotation::by(&-deviation.angular).matrix();
        match &self.surface {
            TuningSurface::Normals(normals) => {
                Normals::new(normals.inward().map(|normal| back * normal))
            }
            TuningSurface::Ball(center) => {
                let desired = center - self.center - deviation.linear;
                Normals::of_ball(contacts, &(back * desired + self.center))
            }
        }
    }
}
