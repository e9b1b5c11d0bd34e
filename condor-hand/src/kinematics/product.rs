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
/// Joint i turns the tip p about the axis a through the point o: the column of the Jacobian is
/// `[a x (p - o); a]`, and `[a; 0]` where it slides (Siciliano et al., *Robotics: Modelling,
/// Planning and Control*, 2009, section 3.1).
impl<const N: usize> Kinematics<N> for Chain<N> {
    fn tip(&self, q: &SVector<f64, N>) -> Pose {
        self.walk(q, |_, _| {})
    }

    fn kinematics(&self, q: &SVector<f64, N>) -> (Pose, Jacobian<N>) {
        let mut screws = [Screw::Still; N];
        let mut places = screws.iter_mut();
        let tip = self.walk(q, |motion, frame| {
            let Some(screw) = places.next() else { return };
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
        for (mut column, screw) in jacobian.column_iter_mut().zip(screws) {
            let (linear, angular) = match screw {
                Screw::Turn { axis, through } => (axis.cross(&(tip.position - through)), axis),
                Screw::Slide { axis } => (axis, Vector3::zeros()),
                Screw::Still => continue,
            };
            column.copy_from(&Vector6::new(
                linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
            ));
        }
        (tip, jacobian)
    }

    /// There is one if the joints that move, four or fewer, are one more than the directions in
    /// which they move the tip: with more than four joints there are always several.
    fn self_motion(&self, q: &SVector<f64, N>) -> Option<SVector<f64, N>> {
        let moving = self.joints.map(|joint| joint.motion != ChainMotion::Fixed);
        let (_, jacobian) = self.kinematics(q);
        null_direction(&jacobian.fixed_rows::<3>(0).into_owned(), &moving)
    }
}

impl<const N: usize> Chain<N> {
    /// The frame at the tip; `joint` gets the frame of each joint before its motion.
    #[inline(always)]
    fn walk(&self, q: &SVector<f64, N>, mut joint: impl FnMut(&ChainMotion, &Pose)) -> Pose {
        let mut frame = self.base;
        for (link, &q) in self.joints.iter().zip(q.iter()) {
            frame = frame.then(&link.placement);
            joint(&link.motion, &frame);
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
