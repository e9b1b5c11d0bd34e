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
/// and has no acceleration, whatever its rates are said to be. A joint that follows another one adds `ratio` times its
/// own torque to that of the other.
impl<const N: usize> Dynamics<N> for Chain<N> {
    fn inverse_dynamics(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        qdd: &SVector<f64, N>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, N> {
        self.torque(&self.moved(q), qd, qdd, gravity)
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
        self.mass(&self.moved(q))
    }

    fn forward_dynamics(
        &self,
        q: &SVector<f64, N>,
        qd: &SVector<f64, N>,
        torque: &SVector<f64, N>,
        gravity: &Vector3<f64>,
        armature: &SVector<f64, N>,
    ) -> Option<SVector<f64, N>> {
        let links = self.moved(q);
        let mut free = torque - self.torque(&links, qd, &SVector::zeros(), gravity);
        let mut mass = self.mass(&links);
        for (i, moves) in self.moving(|_| true).into_iter().enumerate() {
            if moves {
                mass[(i, i)] += armature[i];
            } else {
                mass[(i, i)] = 1.0;
                free[i] = 0.0;
            }
        }
        let acceleration = Ldl::leading(&mass, self.count())?.solve(&free);
        acceleration
            .iter()
            .all(|&entry| is_finite(entry))
            .then_some(acceleration)
    }
}

impl<const N: usize> Chain<N> {
    #[inline(always)]
    fn moved(&self, q: &SVector<f64, N>) -> [Link; N] {
        let mut links = [Link::none(); N];
        let all = links
            .iter_mut()
            .zip(&self.joints)
            .zip(&self.links)
            .take(self.count());
        for ((link, joint), place) in all {
            *link = Link::of(joint, place.position(q));
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
        let base = Motion {
            linear: -self.base.rotation.tr_mul(gravity),
            rate: Vector3::zeros(),
            acceleration: Vector3::zeros(),
        };
        let mut motions = [base; N];
        let mut loads = [(Vector3::zeros(), Vector3::zeros()); N];
        for i in 0..self.count() {
            let place = &self.links[i];
            let carrier = place.carrier.and_then(|carrier| motions.get(carrier));
            let motion = links[i].motion(carrier.unwrap_or(&base), place.rate(qd), place.rate(qdd));
            loads[i] = load_of(&self.bodies[i], &motion);
            motions[i] = motion;
        }

        let mut torques = [0.0; N];
        for i in (0..self.count()).rev() {
            let place = &self.links[i];
            let (force, moment) = loads[i];
            if let Some(torque) = torques.get_mut(place.coordinate) {
                *torque += place.ratio * links[i].torque(&force, &moment);
            }
            if let Some(load) = place.carrier.and_then(|carrier| loads.get_mut(carrier)) {
                let (force, moment) = links[i].wrench_before(&force, &moment);
                load.0 += force;
                load.1 += moment;
            }
        }
        torques.into()
    }

    fn mass(&self, links: &[Link; N]) -> SMatrix<f64, N, N> {
        let mut composites = [Composite::nothing(); N];
        let mut mass = SMatrix::<f64, N, N>::zeros();
        for i in (0..self.count()).rev() {
            let place = &self.links[i];
            composites[i].add(&self.bodies[i]);
            let composite = composites[i];
            let mut link = &links[i];
            // The wrench that accelerates this joint, and all beyond it, by one unit.
            let (mut force, mut moment) = composite.wrench(&link.turns, &link.slides);
            let own = (place.coordinate, place.coordinate);
            if let Some(entry) = mass.get_mut(own) {
                *entry += place.ratio * place.ratio * link.torque(&force, &moment);
            }
            let mut carrier = place.carrier;
            while let Some(before) = carrier
                && let Some((next, other)) = links.get(before).zip(self.links.get(before))
            {
                (force, moment) = link.wrench_before(&force, &moment);
                let coupled = place.ratio * other.ratio * next.torque(&force, &moment);
                let (row, column) = (place.coordinate, other.coordinate);
                for place in [(row, column), (column, row)] {
                    if let Some(entry) = mass.get_mut(place) {
                        *entry += coupled;
                    }
                }
                (link, carrier) = (next, other.carrier);
            }
            let carrier = place.carrier;
            if let Some(before) = carrier.and_then(|carrier| composites.get_mut(carrier)) {
                before.join(&composite.before(&links[i]));
            }
        }
        mass
    }
}

/// The motion of a link, in its own frame.
#[derive(Clone, Copy)]
struct Motion {
    /// The acceleration of its origin, m/s².
    linear: Vector3<f64>,
    /// The angular velocity, rad/s.
    rate: Vector3<f64>,
    /// The angular acceleration, rad/s².
    acceleration: Vector3<f64>,
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

    /// The motion of this link on one that moves like this, by the rate and the acceleration of its joint.
    #[inline(always)]
    fn motion(&self, carrier: &Motion, qd: f64, qdd: f64) -> Motion {
        let Pose { rotation, position } = &self.pose;
        let Motion {
            linear,
            rate,
            acceleration,
        } = carrier;
        let carried = linear + acceleration.cross(position) + rate.cross(&rate.cross(position));
        let turned = rotation.tr_mul(rate);
        let turning = self.turns * qd;
        let rate = turned + turning;
        let sliding = rate.cross(&(self.slides * qd));
        Motion {
            linear: rotation.tr_mul(&carried) + self.slides * qdd + sliding + sliding,
            rate,
            acceleration: rotation.tr_mul(acceleration) + self.turns * qdd + turned.cross(&turning),
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
fn load_of(body: &ChainBody, motion: &Motion) -> (Vector3<f64>, Vector3<f64>) {
    let Motion {
        linear,
        rate,
        acceleration,
    } = motion;
    let center = &body.center;
    let at_center = linear + acceleration.cross(center) + rate.cross(&rate.cross(center));
    let force = at_center * body.mass;
    let spin = body.inertia * acceleration + rate.cross(&(body.inertia * rate));
    (force, spin + center.cross(&force))
}

/// Bodies that move as one, in the frame of a link.
#[derive(Clone, Copy)]
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

    #[inline(always)]
    fn join(&mut self, other: &Self) {
        self.mass += other.mass;
        self.first_moment += other.first_moment;
        self.inertia += other.inertia;
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
