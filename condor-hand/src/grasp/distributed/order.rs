use nalgebra::{Matrix6, Vector3};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::{GraspReason, LEAST_FINGERS, MOST_FINGERS};
use crate::grasp::{
    ContactFriction, GraspError, GraspTuning, Posture, SpatialGain, Squeeze, TorqueLimits,
    TuningSurface, Wrench,
};

/// An order to the processors of a hand to grasp an object, or to let it go: the fingers that hold, the
/// positions of their tips, and the stiffness and forces of the grasp. All vectors are in the axes of the palm.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct GraspOrder {
    /// The fingers that hold: bit *i* stands for finger *i* of the configuration; 0 lets go.
    pub fingers: u64,
    /// The stiffness of the object about its middle, N/m, N/rad, N m/m, N m/rad.
    pub stiffness: [[f64; 6]; 6],
    /// The damping of the object about its middle, in the units of the stiffness times s.
    pub damping: [[f64; 6]; 6],
    /// The desired position of the middle of the object, m.
    pub center: [f64; 3],
    /// The force on its middle in addition, such as that which bears its weight, N.
    pub force: [f64; 3],
    /// The moment in addition, about its middle, N m.
    pub moment: [f64; 3],
    /// The desired positions of the tips, m; any numbers for fingers that do not hold.
    pub tips: [[f64; 3]; MOST_FINGERS],
    /// The force between each pair of tips, N.
    pub squeeze_n: f64,
    /// The stiffness that keeps the posture of a finger along its self-motion, N m/rad.
    pub posture_stiffness: f64,
    /// The damping along the self-motion, N m s/rad.
    pub posture_damping: f64,
    /// The coefficient of friction, from which the distances of the fingers from slipping are
    /// computed.
    pub friction: f64,
    /// The time in which squeeze, feed-forward and tips become what is ordered, s.
    pub ramp_s: f64,
}

impl GraspOrder {
    /// The order to let the object go; after it no finger holds.
    pub const RELEASE: Self = Self {
        fingers: 0,
        stiffness: [[0.0; 6]; 6],
        damping: [[0.0; 6]; 6],
        center: [0.0; 3],
        force: [0.0; 3],
        moment: [0.0; 3],
        tips: [[0.0; 3]; MOST_FINGERS],
        squeeze_n: 0.0,
        posture_stiffness: 0.0,
        posture_damping: 0.0,
        friction: 0.5,
        ramp_s: 0.0,
    };

    /// The fingers that hold.
    pub(super) fn holding(&self) -> impl Iterator<Item = usize> + Clone + use<> {
        let fingers = self.fingers;
        (0..MOST_FINGERS).filter(move |&finger| fingers >> finger & 1 != 0)
    }

    /// Checks that a grasp of a hand with this number of fingers can have these numbers.
    pub(super) fn check(&self, fingers: usize) -> Result<(), GraspReason> {
        if self.fingers >> fingers != 0 || self.fingers.count_ones() < LEAST_FINGERS {
            return Err(GraspReason::Fingers);
        }
        let mut numbers = self.tips.as_flattened().iter().chain([&self.ramp_s]);
        let tuning = self.tuning([TorqueLimits::<0>::none(); 3]);
        if tuning.is_err() || numbers.any(|number| !number.is_finite()) {
            return Err(GraspReason::Tuning);
        }
        Ok(())
    }

    /// The tuning of the law for this order.
    pub(super) fn tuning<const M: usize, const N: usize>(
        &self,
        limits: [TorqueLimits<N>; M],
    ) -> Result<GraspTuning<M, N>, GraspError> {
        let gain = |rows: &[[f64; 6]; 6]| SpatialGain::new(&by_columns(rows));
        let center = Vector3::from(self.center);
        Ok(GraspTuning {
            stiffness: gain(&self.stiffness)?,
            damping: gain(&self.damping)?,
            center,
            feed_forward: Wrench {
                force: Vector3::from(self.force),
                moment: Vector3::from(self.moment),
            },
            squeeze: Squeeze::equal(self.squeeze_n)?,
            surface: TuningSurface::Ball(center),
            friction: ContactFriction::point(self.friction)?,
            posture: Posture {
                stiffness: self.posture_stiffness,
                damping: self.posture_damping,
            },
            limits,
        })
    }

    /// This order, with squeeze, feed-forward and tips on the way from those of another order for
    /// the same fingers.
    pub(super) fn after(&self, from: &Self, part: f64) -> Self {
        let mix = |from: [f64; 3], to: [f64; 3]| {
            let (from, to) = (Vector3::from(from), Vector3::from(to));
            (from + (to - from) * part).into()
        };
        let mut tips = self.tips;
        for (tip, from) in tips.iter_mut().zip(from.tips) {
            *tip = mix(from, *tip);
        }
        Self {
            force: mix(from.force, self.force),
            moment: mix(from.moment, self.moment),
            squeeze_n: from.squeeze_n + (self.squeeze_n - from.squeeze_n) * part,
            tips,
            ..*self
        }
    }
}

/// The columns of a matrix that is made of rows are the rows.
pub(super) fn by_columns(rows: &[[f64; 6]; 6]) -> Matrix6<f64> {
    Matrix6::from(*rows).transpose()
}
