//! The pose and the Jacobian of any chain, joint by joint.

use nalgebra::{SVector, Vector3, Vector6};

use super::null::null_direction;
use super::{Chain, ChainMotion, Jacobian, Kinematics};
use crate::pose::{Pose, rotation_about};

/// The motion of the links beyond a joint with that joint, in the palm.
#[derive(Clone, Copy)]
enum Screw {
    Turn {
        axis: Vector3<f64>,
        through: Vector3<f64>,
    },
    Slide {
        axis: Vector3<f64>,
    },
    Still,
}

/// The product of placements and motions.
///
/// A joint that follows another one adds `ratio` times its own column to that of the other.
///
/// Joint i turns the tip p about the axis a through the point o: the column of the Jacobian is
/// `[a x (p - o); a]`, and `[a; 0]` where it slides (Siciliano et al., *Robotics: Modelling,
/// Planning and Control*, 2009, section 3.1).
impl<const N: usize> Kinematics<N> for Chain<N> {
    fn tip(&self, q: &SVector<f64, N>) -> Pose {
        self.walk(q, |_, _, _| {})
    }

    fn kinematics(&self, q: &SVector<f64, N>) -> (Pose, Jacobian<N>) {
        let mut screws = [Screw::Still; N];
        let tip = self.walk(q, |number, motion, frame| {
            let Some(screw) = screws.get_mut(number) else {
                return;
            };
            *screw = match motion {
                ChainMotion::Revolute(axis) => Screw::Turn {
                    axis: frame.rotation * axis,
                    through: frame.position,
                },
                ChainMotion::Prismatic(axis) => Screw::Slide {
                    axis: frame.rotation * axis,
                },
                ChainMotion::Fixed => Screw::Still,
            };
        });
        let mut jacobian = Jacobian::<N>::zeros();
        for (link, screw) in self.links.iter().zip(screws) {
            let (linear, angular) = match screw {
                Screw::Turn { axis, through } => (axis.cross(&(tip.position - through)), axis),
                Screw::Slide { axis } => (axis, Vector3::zeros()),
                Screw::Still => continue,
            };
            if let Some(column) = jacobian.data.0.get_mut(link.coordinate) {
                let screw = Vector6::new(
                    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
                );
                for (entry, part) in column.iter_mut().zip(&screw) {
                    *entry += link.ratio * part;
                }
            }
        }
        (tip, jacobian)
    }

    /// There is one if the joints that move, four or fewer, are one more than the directions in
    /// which they move the tip: with more than four joints there are always several.
    fn self_motion(&self, q: &SVector<f64, N>) -> Option<SVector<f64, N>> {
        let moving = self.moving(|link| link.carries_tip);
        let (_, jacobian) = self.kinematics(q);
        null_direction(&jacobian.fixed_rows::<3>(0).into_owned(), &moving)
    }
}

impl<const N: usize> Chain<N> {
    /// The frame at the tip; `joint` gets the number and the frame, before its motion, of each joint on the way there.
    #[inline(always)]
    fn walk(&self, q: &SVector<f64, N>, mut joint: impl FnMut(usize, &ChainMotion, &Pose)) -> Pose {
        let mut frame = self.base;
        for (number, (link, place)) in self.joints.iter().zip(&self.links).enumerate() {
            if !place.carries_tip {
                continue;
            }
            frame = frame.then(&link.placement);
            joint(number, &link.motion, &frame);
            let q = place.position(q);
            match link.motion {
                ChainMotion::Revolute(axis) => frame.rotation *= rotation_about(&axis, q),
                ChainMotion::Prismatic(axis) => frame.position += frame.rotation * axis * q,
                ChainMotion::Fixed => {}
            }
        }
        Pose {
            position: frame.transform(&self.tip),
            ..frame
        }
    }
}
