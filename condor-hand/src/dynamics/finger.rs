use nalgebra::{Matrix4, SVector, Vector3, Vector4};

use super::Dynamics;
use crate::control::linear::Symmetric3;
use crate::kinematics::PlanarFinger;
use crate::math::{is_finite, of_sum, sin_cos};

/// In closed form, with the four sines and cosines of one posture.
///
/// In the plane that the first joint turns, each body has a radius from the first axis and a
/// height, and its flexion angle is the sum of the joint angles up to it. Newton's law in that
/// cylindrical frame, with the moments of each body about its principal axes, gives the torques from
/// the tip to the base; Lagrange's equations in the flexion angles give the mass matrix, in which
/// the first joint is free of the others.
impl Dynamics<4> for PlanarFinger {
    #[inline]
    fn inverse_dynamics(
        &self,
        q: &SVector<f64, 4>,
        qd: &SVector<f64, 4>,
        qdd: &SVector<f64, 4>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, 4> {
        let posture = Posture::of(q);
        self.torque(&posture, qd, qdd, &posture.turned(self, gravity))
    }

    #[inline]
    fn bias(
        &self,
        q: &SVector<f64, 4>,
        qd: &SVector<f64, 4>,
        gravity: &Vector3<f64>,
    ) -> SVector<f64, 4> {
        self.inverse_dynamics(q, qd, &Vector4::zeros(), gravity)
    }

    #[inline]
    fn gravity_torque(&self, q: &SVector<f64, 4>, gravity: &Vector3<f64>) -> SVector<f64, 4> {
        let posture = Posture::of(q);
        let pull = posture.turned(self, gravity);
        let [root, ..] = &self.bodies;
        let mut torque = Vector4::zeros();
        let mut outer = 0.0;
        let mut arm = root.mass * root.center;
        for (k, moment) in self.first_moments().into_iter().enumerate().rev() {
            outer += moment * (posture.sine[k] * pull.radial + posture.cosine[k] * pull.axial);
            torque[k + 1] = outer;
            arm += moment * posture.cosine[k];
        }
        let [base, ..] = self.lengths;
        let [_, bodies @ ..] = &self.bodies;
        for body in bodies {
            arm += body.mass * base;
        }
        torque[0] = -pull.tangential * arm;
        torque
    }

    #[inline]
    fn mass_matrix(&self, q: &SVector<f64, 4>) -> Matrix4<f64> {
        let (turn, bend) = self.inertia(&Posture::of(q));
        let Symmetric3 {
            xx,
            xy,
            xz,
            yy,
            yz,
            zz,
        } = bend;
        let o = 0.0;
        Matrix4::new(turn, o, o, o, o, xx, xy, xz, o, xy, yy, yz, o, xz, yz, zz)
    }

    #[inline]
    fn forward_dynamics(
        &self,
        q: &SVector<f64, 4>,
        qd: &SVector<f64, 4>,
        torque: &SVector<f64, 4>,
        gravity: &Vector3<f64>,
        armature: &SVector<f64, 4>,
    ) -> Option<SVector<f64, 4>> {
        let posture = Posture::of(q);
        let pull = posture.turned(self, gravity);
        let free = torque - self.torque(&posture, qd, &Vector4::zeros(), &pull);
        let (turn, mut bend) = self.inertia(&posture);
        let turn = turn + armature.x;
        bend.xx += armature.y;
        bend.yy += armature.z;
        bend.zz += armature.w;
        let bent = solve(&bend, &Vector3::new(free.y, free.z, free.w))?;
        let accelerations = Vector4::new(free.x / turn, bent.x, bent.y, bent.z);
        // Zero times each: the sum is NaN if one of them is not finite.
        let finite = is_finite((accelerations * 0.0).sum());
        (turn > 0.0 && finite).then_some(accelerations)
    }
}

/// The sines and cosines of the turn and of the three flexion angles.
struct Posture {
    turn: (f64, f64),
    sine: [f64; 3],
    cosine: [f64; 3],
}

/// Gravity as the turned plane sees it: in the plane, across it, and along the first axis.
struct Pull {
    radial: f64,
    tangential: f64,
    axial: f64,
}

impl Posture {
    #[inline(always)]
    fn of(q: &Vector4<f64>) -> Self {
        // By addition theorems: the sum of two angles could overflow.
        let first = sin_cos(q.y);
        let second = of_sum(first, sin_cos(q.z));
        let third = of_sum(second, sin_cos(q.w));
        Self {
            turn: sin_cos(q.x),
            sine: [first.0, second.0, third.0],
            cosine: [first.1, second.1, third.1],
        }
    }

    #[inline(always)]
    fn turned(&self, finger: &PlanarFinger, gravity: &Vector3<f64>) -> Pull {
        let g = finger.base.rotation.tr_mul(gravity);
        let (sine, cosine) = self.turn;
        Pull {
            radial: g.x * cosine + g.y * sine,
            tangential: g.y * cosine - g.x * sine,
            axial: g.z,
        }
    }
}

impl PlanarFinger {
    /// Newton and Euler, outwards for the accelerations and inwards for the torques.
    #[inline(always)]
    fn torque(
        &self,
        posture: &Posture,
        qd: &Vector4<f64>,
        qdd: &Vector4<f64>,
        pull: &Pull,
    ) -> Vector4<f64> {
        let [root, bodies @ ..] = &self.bodies;
        let [base, lengths @ ..] = self.lengths;
        let Posture { sine, cosine, .. } = posture;
        let two = 2.0;
        let turning = qd.x * qd.x;

        // The axis of the next link: radius and its rate, accelerations along radius and height.
        let (mut radius, mut radius_rate) = (base, 0.0);
        let (mut outward, mut upward) = (0.0, 0.0);
        let (mut rate, mut acceleration) = (0.0, 0.0);

        let mut torque = Vector4::zeros();
        torque.x = root.inertia.z * qdd.x
            + root.mass * root.center * (root.center * qdd.x - pull.tangential);
        let mut forces = [(0.0, 0.0); 3];
        let mut moments = [0.0; 3];
        for k in 0..3 {
            let (s, c, body, length) = (sine[k], cosine[k], &bodies[k], lengths[k]);
            rate += qd[k + 1];
            acceleration += qdd[k + 1];
            // The change of each quantity per metre along the link.
            let drift = -rate * s;
            let swing_out = -acceleration * s - rate * rate * c;
            let swing_up = rate * rate * s - acceleration * c;

            let at = radius + body.center * c;
            let at_rate = radius_rate + body.center * drift;
            let outward_here = outward + body.center * swing_out;
            let upward_here = upward + body.center * swing_up;
            forces[k] = (
                body.mass * (outward_here - at * turning - pull.radial),
                body.mass * (upward_here - pull.axial),
            );
            let sideways = body.mass * (at * qdd.x + two * at_rate * qd.x - pull.tangential);

            // The angular momentum about the first axis is `spin` times its rate.
            let [[along, across, upright]] = body.inertia.data.0;
            let spin = upright * c * c + along * s * s;
            let skew = (along - upright) * s * c;
            torque.x += at * sideways + spin * qdd.x + two * skew * rate * qd.x;
            moments[k] = across * acceleration - skew * turning;

            radius += length * c;
            radius_rate += length * drift;
            outward += length * swing_out;
            upward += length * swing_up;
        }

        let (mut out, mut up, mut moment) = (0.0, 0.0, 0.0);
        for k in (0..3).rev() {
            let (s, c, length) = (sine[k], cosine[k], lengths[k]);
            let (force_out, force_up) = forces[k];
            let center = bodies[k].center;
            moment += moments[k]
                - s * (center * force_out + length * out)
                - c * (center * force_up + length * up);
            out += force_out;
            up += force_up;
            torque[k + 1] = moment;
        }
        torque
    }

    /// Mass times distance along each flexion link, with what that link carries at its end.
    #[inline(always)]
    fn first_moments(&self) -> [f64; 3] {
        let [_, l1, l2, _] = self.lengths;
        let [_, b1, b2, b3] = &self.bodies;
        [
            b1.mass * b1.center + l1 * (b2.mass + b3.mass),
            b2.mass * b2.center + l2 * b3.mass,
            b3.mass * b3.center,
        ]
    }

    /// The inertia of the turn and that of the three flexion joints.
    ///
    /// With flexion angles a, the kinetic energy of bending is half the sum of
    /// `c[i][j] cos(a[i] - a[j])` times the rates of both angles; the sums from the tip
    /// go from these angles to those of the joints.
    #[inline(always)]
    fn inertia(&self, posture: &Posture) -> (f64, Symmetric3) {
        let [base, l1, l2, _] = self.lengths;
        let [root, b1, b2, b3] = &self.bodies;
        let Posture {
            sine: [s1, s2, s3],
            cosine: [c1, c2, c3],
            ..
        } = *posture;
        let [_, moment2, moment3] = self.first_moments();

        let own1 = b1.inertia.y + b1.mass * b1.center * b1.center + l1 * l1 * (b2.mass + b3.mass);
        let own2 = b2.inertia.y + b2.mass * b2.center * b2.center + l2 * l2 * b3.mass;
        let own3 = b3.inertia.y + b3.mass * b3.center * b3.center;
        let b12 = l1 * moment2 * (c1 * c2 + s1 * s2);
        let b13 = l1 * moment3 * (c1 * c3 + s1 * s3);
        let b23 = l2 * moment3 * (c2 * c3 + s2 * s3);
        let zz = own3;
        let yz = b23 + zz;
        let yy = own2 + b23 + yz;
        let xz = b13 + yz;
        let xy = b12 + b13 + yy;
        let xx = own1 + b12 + b13 + xy;

        let axis2 = base + l1 * c1;
        let axis3 = axis2 + l2 * c2;
        let mut turn = root.inertia.z + root.mass * root.center * root.center;
        for (body, axis, s, c) in [(b1, base, s1, c1), (b2, axis2, s2, c2), (b3, axis3, s3, c3)] {
            let radius = axis + body.center * c;
            turn += body.mass * radius * radius + body.inertia.z * c * c + body.inertia.x * s * s;
        }
        let bend = Symmetric3 {
            xx,
            xy,
            xz,
            yy,
            yz,
            zz,
        };
        (turn, bend)
    }
}

/// By cofactors, for one division; `None` where the matrix is not positive definite, which its leading
/// minors say.
#[inline(always)]
fn solve(matrix: &Symmetric3, rhs: &Vector3<f64>) -> Option<Vector3<f64>> {
    let (adjugate, determinant) = matrix.adjugate();
    let positive = matrix.xx > 0.0 && adjugate.zz > 0.0 && determinant > 0.0;
    positive.then(|| adjugate.times(rhs) * (1.0 / determinant))
}
