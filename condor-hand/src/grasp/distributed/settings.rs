mod image;
#[cfg(feature = "text")]
mod text;

use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

use super::order::by_columns;
use super::{GraspOrder, MOST_FINGERS};
use crate::grasp::{ContactFriction, GraspError, SpatialGain, Squeeze};
use crate::math::sqrt;
use crate::number::not_negative;
use crate::pose::{Pose, rotation_of};

/// The axes in which the stiffness and the damping of a [`GraspSettings`] are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GraspAxes {
    /// The axes of the palm.
    #[default]
    Palm,
    /// The axes of the object, as it is measured when the order is made.
    Object,
}

/// The parameters of a grasp that depend neither on the place of the object nor on the fingers that hold it: stiffness,
/// damping, squeeze, friction and so on.
///
/// [`order`](Self::order) makes a [`GraspOrder`] from the settings. People write settings as TOML (`from_toml`, feature
/// `text`); a processor loads them as an image ([`from_image`](Self::from_image)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspSettings {
    /// The stiffness of the object about its middle, N/m, N/rad, N m/m, N m/rad.
    pub stiffness: [[f64; 6]; 6],
    /// The damping of the object about its middle, in the units of the stiffness times s.
    pub damping: [[f64; 6]; 6],
    /// The axes of stiffness and damping.
    pub axes: GraspAxes,
    /// The mass of the object, whose weight the fingers bear, kg.
    pub mass_kg: f64,
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

/// The measured pose and radius of a ball, the object of a grasp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredBall {
    /// The pose of its middle in the palm.
    pub pose: Pose,
    /// The radius of the ball, m.
    pub radius_m: f64,
}

impl MeasuredBall {
    /// Makes a ball from measurements in the axes of the palm: `position` of its middle (m), `orientation` as a unit
    /// quaternion with the real part first, and `radius_m` (m).
    #[must_use]
    pub fn new(position: [f64; 3], orientation: [f64; 4], radius_m: f64) -> Self {
        let [w, x, y, z] = orientation;
        let pose = Pose {
            rotation: rotation_of(w, &Vector3::new(x, y, z)),
            position: position.into(),
        };
        Self { pose, radius_m }
    }
}

impl GraspSettings {
    /// Makes settings whose axes do not influence each other. `stiffness` are the gains along x, y and z (N/m) and
    /// about x, y and z (N m/rad); `damping` are those in N s/m and N m s/rad. The other parameters have usual values,
    /// such as a squeeze of 1.5 N.
    #[must_use]
    pub fn diagonal(stiffness: [f64; 6], damping: [f64; 6]) -> Self {
        let diagonal = |gains: [f64; 6]| Matrix6::from_diagonal(&gains.into()).into();
        Self {
            stiffness: diagonal(stiffness),
            damping: diagonal(damping),
            axes: GraspAxes::Palm,
            mass_kg: 0.0,
            squeeze_n: 1.5,
            posture_stiffness: 0.1,
            posture_damping: 2e-3,
            friction: 0.5,
            ramp_s: 1.0,
        }
    }

    /// Checks that a grasp can have these values, for example that no gain is negative.
    ///
    /// # Errors
    /// [`GraspError`] for the first wrong value.
    pub fn check(&self) -> Result<(), GraspError> {
        for gains in [&self.stiffness, &self.damping] {
            SpatialGain::new(&by_columns(gains))?;
        }
        not_negative("the mass of the object, kg,", self.mass_kg)?;
        Squeeze::<3>::equal(self.squeeze_n)?;
        not_negative(
            "the stiffness of the posture, N m/rad,",
            self.posture_stiffness,
        )?;
        not_negative(
            "the damping of the posture, N m s/rad,",
            self.posture_damping,
        )?;
        ContactFriction::point(self.friction)?;
        not_negative("the time of the ramp, s,", self.ramp_s)?;
        Ok(())
    }

    /// Makes the order to hold a ball in the place where it was measured.
    ///
    /// `fingers` are the fingers that hold: bit *i* stands for finger *i*. `tips` are the present positions of the
    /// fingertips (m, in the palm); each tip is ordered to the nearest point of the ball. The fingers also bear the
    /// weight of the ball; `gravity` (m/s²) is in the axes of the palm.
    #[must_use]
    pub fn order<const F: usize>(
        &self,
        fingers: u64,
        tips: &[[f64; 3]; F],
        ball: &MeasuredBall,
        gravity: &[f64; 3],
    ) -> GraspOrder {
        let center = ball.pose.position;
        let mut tips = all(tips);
        for tip in &mut tips {
            let from = Vector3::from(*tip) - center;
            let distance = sqrt(from.norm_squared());
            if distance > 0.0 {
                *tip = (center + from * (ball.radius_m / distance)).into();
            }
        }
        let turned = |gains: &[[f64; 6]; 6]| match self.axes {
            GraspAxes::Palm => *gains,
            GraspAxes::Object => turned(gains, &ball.pose.rotation),
        };
        GraspOrder {
            fingers,
            stiffness: turned(&self.stiffness),
            damping: turned(&self.damping),
            center: center.into(),
            force: (Vector3::from(*gravity) * -self.mass_kg).into(),
            tips,
            squeeze_n: self.squeeze_n,
            posture_stiffness: self.posture_stiffness,
            posture_damping: self.posture_damping,
            friction: self.friction,
            ramp_s: self.ramp_s,
            ..GraspOrder::RELEASE
        }
    }
}

impl GraspOrder {
    /// Makes an order to hold an object by its present contacts.
    ///
    /// `fingers` are the fingers that hold: bit *i* stands for finger *i*. `tips` are the positions
    /// of the fingertips (m, in the palm); the middle of the object is the mean of the tips that
    /// hold. `stiffness` are the gains along x, y and z (N/m) and about x, y and z (N m/rad);
    /// `damping` are those in N s/m and N m s/rad.
    #[must_use]
    pub fn hold<const F: usize>(
        fingers: u64,
        tips: [[f64; 3]; F],
        stiffness: [f64; 6],
        damping: [f64; 6],
    ) -> Self {
        let mut center = Vector3::zeros();
        let mut count = 0.0;
        for (finger, tip) in tips.iter().enumerate() {
            if fingers >> finger & 1 != 0 {
                center += Vector3::from(*tip);
                count += 1.0;
            }
        }
        if count > 0.0 {
            center /= count;
        }
        let ball = MeasuredBall::new(center.into(), [1.0, 0.0, 0.0, 0.0], 0.0);
        Self {
            tips: all(&tips),
            ..GraspSettings::diagonal(stiffness, damping).order(fingers, &tips, &ball, &[0.0; 3])
        }
    }
}

/// The tips of a hand in an order, with zeros after them.
fn all<const F: usize>(tips: &[[f64; 3]; F]) -> [[f64; 3]; MOST_FINGERS] {
    const { assert!(F <= MOST_FINGERS) };
    let mut all = [[0.0; 3]; MOST_FINGERS];
    for (place, tip) in all.iter_mut().zip(tips) {
        *place = *tip;
    }
    all
}

/// Gains about axes that are turned like this, in the axes in which these stand.
fn turned(rows: &[[f64; 6]; 6], rotation: &Matrix3<f64>) -> [[f64; 6]; 6] {
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation);
    // Symmetric again, whatever has been rounded: rows and columns do not differ then.
    let gains = turn * by_columns(rows) * turn.transpose();
    ((gains + gains.transpose()) * 0.5).into()
}
