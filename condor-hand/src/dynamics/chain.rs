use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::Dynamics;
use crate::control::linear::Ldl;
use crate::kinematics::{Chain, ChainBody, ChainJoint, ChainMotion};
use crate::math::is_finite;
use crate::pose::{Pose, rotation_about};

/// By the recursive Newton–Euler and composite-rigid-body algorithms, in the frames of the links.
///
/// R. Featherstone, *Rigid Body Dynamics Algorithms*, Springer 2008: chapters 5 and 6, in the
/// ordinary 3-vectors of the paper by Luh, Walker and Paul (1980). A fixed joint takes no torque
/// and has no acceleration, whatever its rates are said to be.
impl<const N: usize> Dynamics<N> for Chain<N> {
    fn inverse_dynamics(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        qdd: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, N> {
        self.torque(&self.links(q), qd, qdd, gravity)
    }

    fn bias(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, N> {
        self.inverse_dynamics(q, qd, &SVector::zeros(), gravity)
    }

    fn gravity_torque(&self, q: &SVector<f64, N>, gravity: &Vector3<f64>) -> SVector<f64, N> {
        self.bias(q, &SVector::zeros(), gravity)
    }

    fn mass_matrix(&self, q: &SVector<f64, N>) -> SMatrix<f64, N, N> {
        self.mass(&self.links(q))
    }

    fn forward_dynamics(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        torque: &SVector<f64, N>,
        gravity: &Vector3<f64>,
        armature: &SVector<f64, N>,
    ) -> Option<SVector<f64, N>> {
        let links = self.links(q);
        let mut free = torque - self.torque(&links, qd, &SVector::zeros(), gravity);
        let mut mass = self.mass(&links);
        for (i, joint) in self.joints.iter().enumerate() {
            if joint.motion == ChainMotion::Fixed {
                mass[(i, i)] = 1.0;
                free[i] = 0.0;
            } else {
                mass[(i, i)] += armature[i];
            }
        }
        let acceleration = Ldl::new(&mass)?.solve(&free);
        acceleration
            .iter()
            .all(|&entry| is_finite(entry))
            .then_some(acceleration)
    }
}

impl<const N: usize> Chain<N> {
    #[inline(always)]
    fn links(&self, q: &SVector<f64, N>) -> [Link; N] {
        let mut links = [Link::none(); N];
        for ((link, joint), &q) in links.iter_mut().zip(&self.joints).zip(q.iter()) {
            *link = Link::of(joint, q);
        }
        links
    }

    /// Newton and Euler, outwards for the accelerations and inwards for the torques.
    fn torque(
        &self,
        links: &[Link; N],
        qd: &SVector<f64, N>,
        qdd: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, N> {
        // A base that is accelerated upwards feels the same as one in the field.
        let mut linear = -self.base.rotation.tr_mul(gravity);
        let mut rate = Vector3::zeros();
        let mut acceleration = Vector3::zeros();
        let mut loads = [(Vector3::zeros(), Vector3::zeros()); N];
        for (i, load) in loads.iter_mut().enumerate() {
            let Link {
                pose,
                turns,
                slides,
            } = &links[i];
            let Pose { rotation, position } = pose;
            let carried = linear + acceleration.cross(position) + rate.cross(&rate.cross(position));
            let turned = rotation.tr_mul(&rate);
            let turning = turns * qd[i];
            rate = turned + turning;
            acceleration = rotation.tr_mul(&acceleration) + turns * qdd[i] + turned.cross(&turning);
            let sliding = rate.cross(&(slides * qd[i]));
            linear = rotation.tr_mul(&carried) + slides * qdd[i] + sliding + sliding;
            *load = load_of(&self.bodies[i], &rate, &acceleration, &linear);
        }

        let mut torque = SVector::<f64, N>::zeros();
        let mut force = Vector3::zeros();
        let mut moment = Vector3::zeros();
        let inwards = links.iter().zip(&loads).rev();
        for ((link, load), torque) in inwards.zip(torque.as_mut_slice().iter_mut().rev()) {
            force += load.0;
            moment += load.1;
            *torque = link.torque(&force, &moment);
            (force, moment) = link.wrench_before(&force, &moment);
        }
        torque
    }

    fn mass(&self, links: &[Link; N]) -> SMatrix<f64, N, N> {
        let mut composite = Composite::nothing();
        let mut mass = SMatrix::<f64, N, N>::zeros();
        for i in (0..N).rev() {
            composite.add(&self.bodies[i]);
            let link = &links[i];
            // The wrench that accelerates this joint, and all beyond it, by one unit.
            let (mut force, mut moment) = composite.wrench(&link.turns, &link.slides);
            mass[(i, i)] = link.torque(&force, &moment);
            for j in (0..i).rev() {
                (force, moment) = links[j + 1].wrench_before(&force, &moment);
                let coupled = links[j].torque(&force, &moment);
                for place in [(i, j), (j, i)] {
                    if let Some(entry) = mass.get_mut(place) {
                        *entry = coupled;
                    }
                }
            }
            composite = composite.before(link);
        }
        mass
    }
}

/// A link at a position of its joint.
#[derive(Clone, Copy)]
struct Link {
    /// In the frame of the link before it.
    pose: Pose,
    /// The angular velocity of a unit rate; zero if the joint does not turn.
    turns: Vector3<f64>,
    /// The velocity of a unit rate; zero if the joint does not slide.
    slides: Vector3<f64>,
}

impl Link {
    /// On the link before it, and fixed.
    #[inline(always)]
    fn none() -> Self {
        Self {
            pose: Pose::identity(),
            turns: Vector3::zeros(),
            slides: Vector3::zeros(),
        }
    }

    #[inline(always)]
    fn of(joint: &ChainJoint, q: f64) -> Self {
        let Pose { rotation, position } = &joint.placement;
        let zero = Vector3::zeros();
        let (pose, turns, slides) = match joint.motion {
            ChainMotion::Revolute(axis) => {
                let rotation = rotation * rotation_about(&axis, q);
                let position = *position;
                (Pose { rotation, position }, axis, zero)
            }
            ChainMotion::Prismatic(axis) => {
                let position = joint.placement.transform(&(axis * q));
                let rotation = *rotation;
                (Pose { rotation, position }, zero, axis)
            }
            ChainMotion::Fixed => (joint.placement, zero, zero),
        };
        Self {
            pose,
            turns,
            slides,
        }
    }

    /// The torque (N m) or force (N) of the joint from a force and a moment about the origin of this link.
    #[inline(always)]
    fn torque(&self, force: &Vector3<f64>, moment: &Vector3<f64>) -> f64 {
        self.turns.dot(moment) + self.slides.dot(force)
    }

    /// A force and a moment about the origin of this link, as the link before it has them.
    #[inline(always)]
    fn wrench_before(
        &self,
        force: &Vector3<f64>,
        moment: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let Pose { rotation, position } = &self.pose;
        let force = rotation * force;
        let moment = rotation * moment + position.cross(&force);
        (force, moment)
    }
}

/// The force, and the moment about the origin of its link, that move a body.
#[inline(always)]
fn load_of(
    body: &ChainBody,
    rate: &Vector3<f64>,
    acceleration: &Vector3<f64>,
    linear: &Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let center = &body.center;
    let at_center = linear + acceleration.cross(center) + rate.cross(&rate.cross(center));
    let force = at_center * body.mass;
    let spin = body.inertia * acceleration + rate.cross(&(body.inertia * rate));
    (force, spin + center.cross(&force))
}

/// Bodies that move as one, in the frame of a link.
struct Composite {
    mass: f64,
    /// Mass times the centre of mass.
    first_moment: Vector3<f64>,
    /// About the origin of the frame.
    inertia: Matrix3<f64>,
}

impl Composite {
    fn nothing() -> Self {
        Self {
            mass: 0.0,
            first_moment: Vector3::zeros(),
            inertia: Matrix3::zeros(),
        }
    }

    #[inline(always)]
    fn add(&mut self, body: &ChainBody) {
        self.mass += body.mass;
        self.first_moment += body.center * body.mass;
        self.inertia += body.inertia + parallel_axes(&body.center, &(body.center * body.mass));
    }

    /// The force, and the moment about the origin, that give these accelerations from rest.
    #[inline(always)]
    fn wrench(
        &self,
        angular: &Vector3<f64>,
        linear: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let force = linear * self.mass + angular.cross(&self.first_moment);
        let moment = self.inertia * angular + self.first_moment.cross(linear);
        (force, moment)
    }

    /// Returns the same bodies in the frame of the link before.
    #[inline(always)]
    fn before(&self, link: &Link) -> Self {
        let Pose { rotation, position } = &link.pose;
        let turned = rotation * self.first_moment;
        let first_moment = turned + position * self.mass;
        // The squares of the sums of both places, less the square that `inertia` has already.
        let shift = parallel_axes(position, &first_moment) + parallel_axes(&turned, position);
        Self {
            mass: self.mass,
            first_moment,
            inertia: rotation * self.inertia * rotation.transpose() + shift,
        }
    }
}

/// `a·b 1 - b aᵀ`: with a place and the same place times a mass, the inertia of that mass there.
#[inline(always)]
fn parallel_axes(a: &Vector3<f64>, b: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(a.dot(b)) - b * a.transpose()
}
