use nalgebra::Vector3;

use crate::kinematics::check_pose;
use crate::math::{atan2, clamp, max, sqrt};
use crate::number::{NumberError, Requirement, check, finite};
use crate::pose::{rotation_about, rotation_vector};
use crate::{Pose, Subject};

/// The path of a tip in space, from one pose to another: a straight line, or an arc of a circle. Along both the tip turns
/// evenly about one axis.
///
/// ```
/// use condor_hand::Pose;
/// use condor_hand::trajectory::CartesianPath;
/// use nalgebra::Vector3;
///
/// // Half a circle about the origin.
/// let (start, via, end) = (Pose::at(0.1, 0.0, 0.0), Vector3::y() * 0.1, Pose::at(-0.1, 0.0, 0.0));
/// let arc = CartesianPath::arc(&start, &via, &end)?;
/// assert!((arc.length() - 0.1 * core::f64::consts::PI).abs() < 1e-12);
/// assert!((arc.at(0.5).position - via).norm() < 1e-12);
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CartesianPath {
    start: Pose,
    shape: Shape,
    /// The axis about which the tip turns, in the palm.
    axis: Vector3<f64>,
    /// The angle by which the tip turns, rad.
    angle: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// The way from the start to the end, m.
    Line(Vector3<f64>),
    Arc {
        center: Vector3<f64>,
        /// The normal of the plane of the circle, about which the arc goes.
        normal: Vector3<f64>,
        /// From the centre to the start, m.
        radius: Vector3<f64>,
        /// The angle of the arc, rad.
        angle: f64,
    },
}

/// The least height of the triangle of an arc's three points, over its base: flatter ones count as a line.
const FLAT: f64 = 1e-6;

impl CartesianPath {
    /// Makes the straight line from `start` to `end`, poses in the palm. The rotation is about one axis by at most half a
    /// turn, the shorter way.
    ///
    /// # Errors
    /// [`NumberError`] if a number is not finite, or a rotation is not orthonormal and right-handed up to 1e-9.
    pub fn line(start: &Pose, end: &Pose) -> Result<Self, NumberError> {
        check_pose(Subject::Whole, start)?;
        check_pose(Subject::Whole, end)?;
        let shift = end.position - start.position;
        finite("the length, m,", sqrt(shift.norm_squared()))?;
        Ok(Self::shaped(start, end, Shape::Line(shift)))
    }

    /// Makes the arc of a circle from `start` through the point `via` (m) to `end`, all in the palm. The rotation is about
    /// one axis by at most half a turn, the shorter way, in proportion to the way along the arc.
    ///
    /// # Errors
    /// [`NumberError`] if a number is not finite, a rotation is not orthonormal and right-handed up to 1e-9, or the three
    /// points are on a line or two of them are the same.
    pub fn arc(start: &Pose, via: &Vector3<f64>, end: &Pose) -> Result<Self, NumberError> {
        check_pose(Subject::Whole, start)?;
        check_pose(Subject::Whole, end)?;
        for &coordinate in via {
            finite("a coordinate, m,", coordinate).map_err(|error| error.at(Subject::Via(0)))?;
        }
        let (to_via, to_end) = (via - start.position, end.position - start.position);
        let normal = to_via.cross(&to_end);
        let square = normal.norm_squared();
        let base = max(to_via.norm_squared(), to_end.norm_squared());
        check(
            "the height of the triangle of start, via point and end, over its longest side,",
            sqrt(square) / base,
            Requirement::Above(FLAT),
        )?;
        // The centre of the circumscribed circle, from the start.
        let chords = to_end * to_via.norm_squared() - to_via * to_end.norm_squared();
        let radius = -chords.cross(&normal) / (2.0 * square);
        let normal = normal / sqrt(square);
        let last = radius + to_end;
        let angle = atan2(normal.dot(&radius.cross(&last)), radius.dot(&last));
        let turn = 2.0 * core::f64::consts::PI;
        let shape = Shape::Arc {
            center: start.position - radius,
            normal,
            radius,
            // The way through the via point is about the normal, also where it is longer than half a turn.
            angle: if angle > 0.0 { angle } else { angle + turn },
        };
        Ok(Self::shaped(start, end, shape))
    }

    fn shaped(start: &Pose, end: &Pose, shape: Shape) -> Self {
        let turn = rotation_vector(&(end.rotation * start.rotation.transpose()));
        let angle = sqrt(turn.norm_squared());
        Self {
            start: *start,
            shape,
            axis: if angle > 0.0 { turn / angle } else { turn },
            angle,
        }
    }

    /// Returns the length of the way of the tip, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        match &self.shape {
            Shape::Line(shift) => sqrt(shift.norm_squared()),
            Shape::Arc { radius, angle, .. } => sqrt(radius.norm_squared()) * angle,
        }
    }

    /// Returns the angle by which the tip turns, rad.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// Returns the pose of the tip in the palm where it has gone `fraction` of the path, from 0 to 1; beyond these it is
    /// that of the nearer end.
    #[must_use]
    pub fn at(&self, fraction: f64) -> Pose {
        let fraction = clamp(fraction, 0.0, 1.0);
        let position = match &self.shape {
            Shape::Line(shift) => self.start.position + shift * fraction,
            Shape::Arc {
                center,
                normal,
                radius,
                angle,
            } => center + rotation_about(normal, angle * fraction) * radius,
        };
        let rotation = if self.angle > 0.0 {
            rotation_about(&self.axis, self.angle * fraction) * self.start.rotation
        } else {
            self.start.rotation
        };
        Pose { rotation, position }
    }
}
