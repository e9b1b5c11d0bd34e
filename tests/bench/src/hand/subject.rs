//! The hand that all contestants have, and the states in which they see it.

use std::fmt::Write as _;

use condor_hand::config;
use condor_hand::kinematics::PlanarFinger;
use fastrand::Rng;
use nalgebra::{Matrix3, SVector, Vector3};

use crate::Result;

pub(super) const FINGERS: usize = 4;
pub(super) const JOINTS: usize = 4;

/// States that calls go through in turn, so that no branch is foretold by the last call.
pub(super) const STATES: usize = 64;

/// The name of our kinematics and dynamics in the tables.
pub(super) const OURS: &str = "PlanarFinger";

/// m/s².
pub(super) const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.80665);

const TEXT: &str = include_str!("../../../../condor-hand/hands/utah-mit.toml");

/// A number for each joint of the hand, finger by finger.
pub(super) type Joints = [SVector<f64, JOINTS>; FINGERS];

/// A state of the hand, and what makes it go on.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    /// Positions, rad.
    pub(super) q: Joints,
    /// Rates, rad/s.
    pub(super) qd: Joints,
    /// Accelerations, rad/s².
    pub(super) qdd: Joints,
    /// Torques, N m.
    pub(super) torque: Joints,
}

/// The shipped hand.
pub(super) struct Subject {
    /// The configuration of the hand.
    pub(super) config: config::Hand<FINGERS, JOINTS>,
    /// Its fingers in closed form.
    pub(super) planar: [PlanarFinger; FINGERS],
    /// The states in which the hand is computed.
    pub(super) states: [State; STATES],
}

impl Subject {
    /// Makes the shipped hand with states all over its range.
    ///
    /// # Errors
    /// Returns an error if its configuration has mistakes.
    pub(super) fn new() -> Result<Self> {
        let config = config::Hand::<FINGERS, JOINTS>::from_toml(TEXT, "utah-mit.toml")
            .map_err(|error| format!("{error}"))?;
        let planar = config
            .fingers
            .iter()
            .map(|finger| finger.planar().ok_or("a finger has another form"))
            .collect::<std::result::Result<Vec<_>, _>>()?;
        let planar: [PlanarFinger; FINGERS] = planar
            .try_into()
            .map_err(|_| "the hand has another number of fingers")?;
        let limits: Vec<_> = config.fingers.iter().map(config::Finger::limits).collect();
        let mut chance = Rng::with_seed(7);
        let states = std::array::from_fn(|_| {
            let mut each = |size: f64| -> Joints {
                std::array::from_fn(|_| SVector::from_fn(|_, _| size * (2.0 * chance.f64() - 1.0)))
            };
            let (qd, qdd, torque) = (each(3.0), each(50.0), each(0.2));
            let q = std::array::from_fn(|finger| {
                let limits = &limits[finger];
                limits
                    .low
                    .zip_map(&limits.high, |low, high| low + (high - low) * chance.f64())
            });
            State { q, qd, qdd, torque }
        });
        Ok(Self {
            config,
            planar,
            states,
        })
    }

    /// Returns the state of a call.
    #[inline]
    pub(super) fn state(&self, call: usize) -> &State {
        &self.states[call % STATES]
    }

    /// Returns the hand as URDF: a palm, and links `finger.joint` and `finger.tip`.
    pub(super) fn urdf(&self) -> String {
        let mut text = String::from("<robot name=\"hand\">\n<link name=\"palm\"/>\n");
        for (finger, planar) in self.planar.iter().enumerate() {
            let chain = planar.chain();
            let mut parent = String::from("palm");
            for (number, (joint, body)) in chain.joints().iter().zip(chain.bodies()).enumerate() {
                let placement = if number == 0 {
                    chain.base().then(&joint.placement)
                } else {
                    joint.placement
                };
                let link = format!("{finger}.{number}");
                let axis = if number == 0 { "0 0 1" } else { "0 1 0" };
                let [[ixx, ..], [_, iyy, _], [.., izz]] = body.inertia.data.0;
                // Writing to a string does not fail.
                let _ = write!(
                    text,
                    "<link name=\"{link}\"><inertial><origin xyz=\"{}\" rpy=\"0 0 0\"/>\
                     <mass value=\"{}\"/><inertia ixx=\"{ixx}\" ixy=\"0\" ixz=\"0\" iyy=\"{iyy}\" \
                     iyz=\"0\" izz=\"{izz}\"/></inertial></link>\n\
                     <joint name=\"joint {link}\" type=\"revolute\"><parent link=\"{parent}\"/>\
                     <child link=\"{link}\"/><origin xyz=\"{}\" rpy=\"{}\"/><axis xyz=\"{axis}\"/>\
                     <limit lower=\"-3\" upper=\"3\" effort=\"10\" velocity=\"100\"/></joint>\n",
                    list(&body.center),
                    body.mass,
                    list(&placement.position),
                    list(&roll_pitch_yaw(&placement.rotation)),
                );
                parent = link;
            }
            let _ = writeln!(
                text,
                "<link name=\"{finger}.tip\"/><joint name=\"joint {finger}.tip\" type=\"fixed\">\
                 <parent link=\"{parent}\"/><child link=\"{finger}.tip\"/>\
                 <origin xyz=\"{}\" rpy=\"0 0 0\"/></joint>",
                list(chain.tip_point()),
            );
        }
        text + "</robot>\n"
    }
}

fn list(vector: &Vector3<f64>) -> String {
    format!("{} {} {}", vector.x, vector.y, vector.z)
}

/// Returns the angles of URDF: about the fixed x, y and z axes, one after the other.
fn roll_pitch_yaw(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let across = rotation.m11.hypot(rotation.m21);
    Vector3::new(
        rotation.m32.atan2(rotation.m33),
        (-rotation.m31).atan2(across),
        rotation.m21.atan2(rotation.m11),
    )
}

/// Returns all joints of the hand in one list.
pub(super) fn flat(joints: &Joints) -> [f64; FINGERS * JOINTS] {
    std::array::from_fn(|index| joints[index / JOINTS][index % JOINTS])
}

/// Returns the distance of two results, relative to the largest number in them.
///
/// # Errors
/// Returns an error if the distance exceeds `limit`, or if the lengths differ.
pub(super) fn agree(what: &str, ours: &[f64], theirs: &[f64], limit: f64) -> Result<f64> {
    if ours.len() != theirs.len() {
        return Err(format!("{what}: {} numbers, not {}", theirs.len(), ours.len()).into());
    }
    let largest = ours
        .iter()
        .fold(0.0, |most: f64, value| most.max(value.abs()));
    let apart = ours.iter().zip(theirs).fold(0.0, |most: f64, (a, b)| {
        let apart = (a - b).abs() / largest;
        // A NaN is the largest of all.
        if apart <= most { most } else { apart }
    });
    if apart <= limit {
        Ok(apart)
    } else {
        Err(format!("{what} is another: {apart:e} of the largest number, not {limit:e}").into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_numbers_do_not_agree() {
        assert!(agree("x", &[1.0, 2.0], &[1.0, 2.0 + 1e-13], 1e-12).is_ok());
        assert!(agree("x", &[1.0, 2.0], &[1.0, 2.1], 1e-12).is_err());
        assert!(agree("x", &[1.0, 2.0], &[1.0, f64::NAN], 1e-12).is_err());
        assert!(agree("x", &[1.0, 2.0], &[1.0], 1e-12).is_err());
    }

    #[test]
    fn angles_make_the_rotation() {
        let rotation = nalgebra::Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        let angles = roll_pitch_yaw(rotation.matrix());
        assert!((angles - Vector3::new(0.3, -1.1, 2.0)).norm() < 1e-14);
    }
}
