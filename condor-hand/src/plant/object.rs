use nalgebra::{Matrix3, Quaternion, Vector3};

use super::check::all_finite;
use super::contact::Overlap;
use crate::Pose;
use crate::grasp::Wrench;
use crate::math::{abs, sin_cos, sqrt};
use crate::number::{NumberError, Requirement, Subject, check, finite, positive};
use crate::pose::rotation_of;

/// The mass, the inertia and the radius of a [`SimObject`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectParameters {
    /// The mass, kg.
    pub mass: f64,
    /// The inertia about the centre of mass in the object's axes, kg m²; symmetric, positive
    /// definite.
    pub inertia: Matrix3<f64>,
    /// The radius of the sphere about the centre of mass that can be touched, m.
    pub radius: f64,
}

/// A simulated rigid object that moves freely, except for gravity and its contacts.
///
/// The origin of the object's frame is its centre of mass. The state of the simulation has the
/// angular momentum instead of the angular velocity, so without a moment the angular momentum is
/// constant to the last bit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimObject {
    parameters: ObjectParameters,
    inverse_inertia: Matrix3<f64>,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    orientation: Quaternion<f64>,
    angular_momentum: Vector3<f64>,
}

impl ObjectParameters {
    /// Returns the parameters of a uniform ball with the mass `mass` (kg) and the radius `radius`
    /// (m).
    #[must_use]
    pub fn ball(mass: f64, radius: f64) -> Self {
        Self {
            mass,
            inertia: Matrix3::from_diagonal_element(0.4 * mass * radius * radius),
            radius,
        }
    }
}

impl SimObject {
    /// Makes an object that is at rest with its centre at `center` (m, in the palm). Its axes are
    /// those of the palm.
    ///
    /// # Errors
    /// [`NumberError`] for the first parameter that is wrong.
    pub fn new(parameters: ObjectParameters, center: Vector3<f64>) -> Result<Self, NumberError> {
        positive("the mass of an object, kg", parameters.mass)?;
        positive("the radius of an object, m", parameters.radius)?;
        all_finite("a coordinate of an object, m", center.iter())?;
        let inertia = &parameters.inertia;
        all_finite("a moment of inertia, kg m²", inertia.iter())?;
        for (row, column) in [((0, 1), (1, 0)), ((0, 2), (2, 0)), ((1, 2), (2, 1))] {
            let difference = entry(inertia, row) - entry(inertia, column);
            let what = "what an inertia differs by from a symmetric one, kg m²";
            check(what, abs(difference), Requirement::AtMost(0.0))?;
        }
        let first = entry(inertia, (0, 0));
        let second =
            first * entry(inertia, (1, 1)) - entry(inertia, (0, 1)) * entry(inertia, (1, 0));
        positive("the first minor of an inertia, kg m²", first)?;
        positive("the second minor of an inertia, kg² m⁴", second)?;
        let determinant = inertia.determinant();
        positive("the determinant of an inertia, kg³ m⁶", determinant)?;
        let inverse_inertia = inertia.try_inverse().ok_or(NumberError {
            at: Subject::Whole,
            what: "the determinant of an inertia, kg³ m⁶",
            value: determinant,
            must: Requirement::Above(0.0),
        })?;
        Ok(Self {
            parameters,
            inverse_inertia,
            position: center,
            velocity: Vector3::zeros(),
            orientation: Quaternion::identity(),
            angular_momentum: Vector3::zeros(),
        })
    }

    /// Returns the object with the velocity of its centre (m/s) and the angular velocity (rad/s).
    ///
    /// # Errors
    /// [`NumberError`] if one of them is not finite.
    pub fn moving(
        mut self,
        velocity: Vector3<f64>,
        angular_velocity: Vector3<f64>,
    ) -> Result<Self, NumberError> {
        all_finite("a velocity, m/s", velocity.iter())?;
        all_finite("an angular velocity, rad/s", angular_velocity.iter())?;
        let rotation = self.rotation();
        self.velocity = velocity;
        self.angular_momentum =
            rotation * (self.parameters.inertia * (rotation.transpose() * angular_velocity));
        Ok(self)
    }

    /// Returns the mass, the inertia and the radius of the object.
    #[must_use]
    pub fn parameters(&self) -> &ObjectParameters {
        &self.parameters
    }

    /// Returns the pose of the object in the frame of the palm.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            rotation: self.rotation(),
            position: self.position,
        }
    }

    /// Returns the orientation of the object in the palm, as a unit quaternion.
    #[must_use]
    pub fn orientation(&self) -> &Quaternion<f64> {
        &self.orientation
    }

    /// Returns the velocity of the object's centre in the axes of the palm, m/s.
    #[must_use]
    pub fn velocity(&self) -> &Vector3<f64> {
        &self.velocity
    }

    /// Returns the angular momentum of the object about its centre, in the axes of the palm, N m s.
    #[must_use]
    pub fn angular_momentum(&self) -> &Vector3<f64> {
        &self.angular_momentum
    }

    /// Returns the angular velocity of the object in the axes of the palm, rad/s.
    #[must_use]
    pub fn angular_velocity(&self) -> Vector3<f64> {
        let rotation = self.rotation();
        rotation * (self.inverse_inertia * (rotation.transpose() * self.angular_momentum))
    }

    pub(super) fn velocity_at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.angular_velocity().cross(&(point - self.position))
    }

    /// Returns the overlap with a sphere, which is the first body of the two.
    pub(super) fn overlap(&self, center: &Vector3<f64>, radius: f64) -> Overlap {
        let between = center - self.position;
        let distance = sqrt(between.norm_squared());
        let depth = self.parameters.radius + radius - distance;
        // Two centres at one point push each other nowhere in particular.
        let normal = if distance > 0.0 {
            between / distance
        } else {
            Vector3::z()
        };
        Overlap {
            depth,
            normal,
            point: self.position + normal * (self.parameters.radius - 0.5 * depth),
        }
    }

    /// One update of `dt` seconds under a wrench about the centre.
    pub(super) fn advance(
        &mut self,
        dt: f64,
        wrench: &Wrench,
        gravity: &Vector3<f64>,
    ) -> Result<(), NumberError> {
        let mut next = *self;
        next.velocity += (gravity + wrench.force / self.parameters.mass) * dt;
        next.position += next.velocity * dt;
        next.angular_momentum += wrench.moment * dt;
        let turn = next.angular_velocity() * dt;
        next.orientation = unit(rotor(&turn) * self.orientation);
        all_finite("where an object would be, m", next.position.iter())?;
        all_finite(
            "the orientation that an object would have",
            next.orientation.coords.iter(),
        )?;
        all_finite(
            "the angular momentum of an object, N m s",
            next.angular_momentum.iter(),
        )?;
        finite("the velocity of an object, m/s", next.velocity.sum())?;
        *self = next;
        Ok(())
    }

    fn rotation(&self) -> Matrix3<f64> {
        let q = &self.orientation;
        rotation_of(q.w, &Vector3::new(q.i, q.j, q.k))
    }
}

fn entry(matrix: &Matrix3<f64>, place: (usize, usize)) -> f64 {
    matrix.get(place).copied().unwrap_or(f64::NAN)
}

/// The quaternion of a rotation vector, rad.
fn rotor(turn: &Vector3<f64>) -> Quaternion<f64> {
    let angle = sqrt(turn.norm_squared());
    let (sine, cosine) = sin_cos(0.5 * angle);
    // sin(a/2)/a is 1/2 to rounding below 1e-8.
    let scale = if angle > 1e-8 { sine / angle } else { 0.5 };
    Quaternion::from_parts(cosine, turn * scale)
}

fn unit(q: Quaternion<f64>) -> Quaternion<f64> {
    q / sqrt(q.coords.norm_squared())
}
