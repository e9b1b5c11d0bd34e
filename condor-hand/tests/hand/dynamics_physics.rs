//! The dynamics of chains of every kind of joint, against the mechanics of points and bodies.
//!
//! The energies come from the places of the bodies alone, by difference quotients; nothing here
//! uses the recursions that are tested.

#![allow(
    clippy::float_cmp,
    reason = "a joint that does not move has exactly zeros"
)]

use std::ops::{Mul, Sub};

use condor_hand::Pose;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::{
    Carrier, Chain, ChainBody, ChainJoint, ChainMotion, Following, Kinematics,
};
use condor_hand::math::max;
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Unit, Vector3, Vector4};
use proptest::prelude::*;

use crate::support::geometry;

type Joints<const N: usize> = SVector<f64, N>;

const STEP: f64 = 1e-3;
const STENCIL: [f64; 4] = [-2.0 * STEP, -STEP, STEP, 2.0 * STEP];

/// The derivative at zero of what has these values at the places of the stencil, to the fourth
/// order of the step.
fn derivative<V>([far_back, back, on, far_on]: [V; 4]) -> V
where
    V: Sub<Output = V> + Mul<f64, Output = V>,
{
    (on - back) * (8.0 / (12.0 * STEP)) - (far_on - far_back) * (1.0 / (12.0 * STEP))
}

/// The place of each joint's number in the vectors: that of the other for one that follows.
fn places<const N: usize>(chain: &Chain<N>) -> [usize; N] {
    let joints = chain.joints();
    let own = |joint: usize| {
        joints[..joint]
            .iter()
            .filter(|it| it.follows.is_none())
            .count()
    };
    std::array::from_fn(|joint| own(joints[joint].follows.map_or(joint, |it| it.joint)))
}

/// The frame of each link, in the palm.
fn frames<const N: usize>(chain: &Chain<N>, q: &Joints<N>) -> [Pose; N] {
    let (mut frames, places) = ([*chain.base(); N], places(chain));
    for (i, joint) in chain.joints().iter().enumerate() {
        let carrier = match joint.on {
            Carrier::Previous => i.checked_sub(1),
            Carrier::Base => None,
            Carrier::Joint(other) => Some(other),
        };
        let carrier = carrier.map_or(*chain.base(), |carrier| frames[carrier]);
        let (ratio, offset) = joint.follows.map_or((1.0, 0.0), |it| (it.ratio, it.offset));
        let position = ratio * q[places[i]] + offset;
        let mut frame = carrier.then(&joint.placement);
        match joint.motion {
            ChainMotion::Revolute(axis) => {
                let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), position);
                frame.rotation *= turn.into_inner();
            }
            ChainMotion::Prismatic(axis) => frame.position = frame.transform(&(axis * position)),
            ChainMotion::Fixed => {}
        }
        frames[i] = frame;
    }
    frames
}

fn potential<const N: usize>(chain: &Chain<N>, q: &Joints<N>, gravity: &Vector3<f64>) -> f64 {
    let frames = frames(chain, q);
    let bodies = frames.iter().zip(chain.bodies());
    bodies
        .map(|(frame, body)| -body.mass * gravity.dot(&frame.transform(&body.center)))
        .sum()
}

/// The mass matrix, from how far each joint moves and turns each body.
fn mass_from_places<const N: usize>(chain: &Chain<N>, q: &Joints<N>) -> SMatrix<f64, N, N> {
    let here = frames(chain, q);
    let mut velocities = [SMatrix::<f64, 3, N>::zeros(); N];
    let mut rates = velocities;
    for joint in 0..N {
        let moved = |t: f64| {
            let mut q = *q;
            q[joint] += t;
            frames(chain, &q)
        };
        let [far_back, back, on, far_on] = STENCIL.map(moved);
        for (link, body) in chain.bodies().iter().enumerate() {
            let center = [&far_back, &back, &on, &far_on].map(|f| f[link].transform(&body.center));
            let axes = [&far_back, &back, &on, &far_on].map(|f| f[link].rotation);
            velocities[link].set_column(joint, &derivative(center));
            // In the axes of the link the derivative of the rotation is the cross matrix of the rate.
            let cross = here[link].rotation.transpose() * derivative(axes);
            let rate = Vector3::new(cross[(2, 1)], cross[(0, 2)], cross[(1, 0)]);
            rates[link].set_column(joint, &rate);
        }
    }
    let mut mass = SMatrix::zeros();
    for (body, (velocity, rate)) in chain.bodies().iter().zip(velocities.iter().zip(&rates)) {
        mass += velocity.transpose() * velocity * body.mass;
        mass += rate.transpose() * body.inertia * rate;
    }
    mass
}

fn kinetic<const N: usize>(chain: &Chain<N>, q: &Joints<N>, qd: &Joints<N>) -> f64 {
    0.5 * qd.dot(&(mass_from_places(chain, q) * qd))
}

/// Lagrange's equations: what each coordinate takes for this motion.
fn lagrange<const N: usize>(
    chain: &Chain<N>,
    q: &Joints<N>,
    qd: &Joints<N>,
    qdd: &Joints<N>,
    gravity: &Vector3<f64>,
) -> Joints<N> {
    let momentum = |t: f64| {
        let rates = qd + qdd * t;
        mass_from_places(chain, &(q + qd * t + qdd * (0.5 * t * t))) * rates
    };
    let momentum_rate = derivative(STENCIL.map(momentum));
    Joints::<N>::from_fn(|i, _| {
        let difference = |t: f64| {
            let mut moved = *q;
            moved[i] += t;
            kinetic(chain, &moved, qd) - potential(chain, &moved, gravity)
        };
        momentum_rate[i] - derivative(STENCIL.map(difference))
    })
}

fn vectors<const N: usize>(largest: f64) -> impl Strategy<Value = Joints<N>> {
    prop::array::uniform(-largest..largest).prop_map(|all: [f64; N]| Joints::from(all))
}

fn in_space(largest: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-largest..largest).prop_map(Vector3::from)
}

fn poses() -> impl Strategy<Value = Pose> {
    (in_space(3.0), in_space(0.5)).prop_map(|(turn, position)| Pose {
        rotation: Rotation3::new(turn).into_inner(),
        position,
    })
}

fn motions() -> impl Strategy<Value = ChainMotion> {
    let axis = in_space(1.0)
        .prop_filter("an axis has a direction", |axis| axis.norm() > 0.1)
        .prop_map(|axis| axis.normalize());
    (axis, 0..5).prop_map(|(axis, kind)| match kind {
        0 => ChainMotion::Fixed,
        1 => ChainMotion::Prismatic(axis),
        _ => ChainMotion::Revolute(axis),
    })
}

fn bodies() -> impl Strategy<Value = ChainBody> {
    // Each moment is the sum of two second moments of the mass.
    let principal =
        prop::array::uniform3(0.005..0.05).prop_map(|[x, y, z]: [f64; 3]| [y + z, x + z, x + y]);
    (0.1..2.0, in_space(0.3), in_space(3.0), principal).prop_map(
        |(mass, center, turn, principal)| {
            let axes = Rotation3::new(turn).into_inner();
            let principal = Matrix3::from_diagonal(&Vector3::from(principal));
            ChainBody {
                mass,
                center,
                inertia: axes * principal * axes.transpose(),
            }
        },
    )
}

fn chains<const N: usize>() -> impl Strategy<Value = Chain<N>> {
    let joint =
        (poses(), motions()).prop_map(|(placement, motion)| ChainJoint::new(placement, motion));
    let joints = prop::array::uniform(joint);
    (poses(), joints, prop::array::uniform(bodies())).prop_map(|(base, joints, bodies)| {
        Chain::new(base, joints, bodies, Vector3::zeros()).unwrap()
    })
}

/// Chains whose links branch, and whose joints follow others.
fn branching<const N: usize>() -> impl Strategy<Value = Chain<N>> {
    let choices =
        prop::array::uniform::<_, N>((0..3_u8, 0..N, 0..4_u8, 0..N, -2.0..2.0, -1.0..1.0));
    (chains::<N>(), choices).prop_map(|(chain, choices)| {
        let mut joints = *chain.joints();
        let moves = |joint: usize| joint == 0 || choices[joint].2 != 0;
        for (joint, (place, (on, carrier, _, other, ratio, offset))) in
            joints.iter_mut().zip(choices).enumerate()
        {
            place.on = match on {
                0 => Carrier::Previous,
                1 => Carrier::Base,
                _ => carrier
                    .checked_rem(joint)
                    .map_or(Carrier::Base, Carrier::Joint),
            };
            let joint_moves = moves(joint);
            place.follows = (!joint_moves).then(|| Following {
                joint: if moves(other) { other } else { 0 },
                ratio,
                offset,
            });
        }
        Chain::new(*chain.base(), joints, *chain.bodies(), *chain.tip_point()).unwrap()
    })
}

/// Returns 1 for each number that moves a joint, and 0 for the others.
fn moving<const N: usize>(chain: &Chain<N>) -> Joints<N> {
    let places = places(chain);
    let mut moving = Joints::<N>::zeros();
    for (joint, place) in chain.joints().iter().zip(places) {
        if joint.motion != ChainMotion::Fixed {
            moving[place] = 1.0;
        }
    }
    moving
}

/// The columns of the Jacobian are the derivatives of the pose of the tip, wherever that is.
fn jacobian_from_places<const N: usize>(
    chain: &Chain<N>,
    q: &Joints<N>,
) -> Result<(), TestCaseError> {
    let (tip, jacobian) = chain.kinematics(q);
    prop_assert_eq!(tip, chain.tip(q));
    for joint in 0..N {
        let moved = STENCIL.map(|t| {
            let mut q = *q;
            q[joint] += t;
            chain.tip(&q)
        });
        let linear = derivative(moved.map(|pose| pose.position));
        let cross = derivative(moved.map(|pose| pose.rotation)) * tip.rotation.transpose();
        let angular = Vector3::new(cross[(2, 1)], cross[(0, 2)], cross[(1, 0)]);
        let column = jacobian.column(joint);
        let difference = (column.fixed_rows::<3>(0) - linear).amax();
        prop_assert!(difference < 1e-8, "{} {}", column, linear);
        let difference = (column.fixed_rows::<3>(3) - angular).amax();
        prop_assert!(difference < 1e-8, "{} {}", column, angular);
    }
    Ok(())
}

fn follow_from_lagrange<const N: usize>(
    chain: &Chain<N>,
    [q, qd, qdd]: [Joints<N>; 3],
    gravity: &Vector3<f64>,
) -> Result<(), TestCaseError> {
    let mass = chain.mass_matrix(&q);
    let difference = (mass - mass_from_places(chain, &q)).amax() / (1e-6 + mass.amax());
    prop_assert!(difference < 1e-9, "{}: {}", difference, mass);
    let torque = chain.inverse_dynamics(&q, &qd, &qdd, gravity);
    let expected = lagrange(chain, &q, &qd, &qdd, gravity);
    let difference = (torque - expected).amax() / (1.0 + expected.amax());
    prop_assert!(difference < 1e-7, "{} {}", torque, expected);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn torques_of_any_chain_follow_from_its_energies(
        chain in branching::<4>(), q in vectors(2.0), qd in vectors(1.0), qdd in vectors(3.0),
        gravity in in_space(10.0),
    ) {
        follow_from_lagrange(&chain, [q, qd, qdd], &gravity)?;
    }

    #[test]
    fn torques_of_an_arm_follow_from_its_energies(
        chain in branching::<7>(), q in vectors(2.0), qd in vectors(1.0), qdd in vectors(3.0),
        gravity in in_space(10.0),
    ) {
        follow_from_lagrange(&chain, [q, qd, qdd], &gravity)?;
    }
}

proptest! {
    #[test]
    fn the_tip_of_any_chain_moves_as_its_jacobian_says(
        chain in branching::<5>(), q in vectors(2.0), link in 0..5_usize, tip in in_space(0.3),
    ) {
        let chain = chain.with_tip(link, tip).unwrap();
        let frame = frames(&chain, &q)[link];
        let place = frame.transform(&tip);
        prop_assert!((chain.tip(&q).position - place).amax() < 1e-12);
        prop_assert_eq!(chain.up_to(link).tip(&q).rotation, chain.tip(&q).rotation);
        jacobian_from_places(&chain, &q)?;
    }

    #[test]
    fn the_torques_of_an_acceleration_cause_it(
        chain in branching::<7>(), q in vectors(3.0), qd in vectors(3.0), qdd in vectors(30.0),
        gravity in in_space(10.0), armature in prop::array::uniform(0.0..0.1),
    ) {
        let armature = Joints::<7>::from(armature);
        let moving = moving(&chain);
        let torque = chain.inverse_dynamics(&q, &qd, &qdd, &gravity)
            + armature.component_mul(&qdd).component_mul(&moving);
        let caused = chain.forward_dynamics(&q, &qd, &torque, &gravity, &armature).unwrap();
        let expected = qdd.component_mul(&moving);
        let difference = (caused - expected).amax();
        prop_assert!(difference < 1e-7 * (1.0 + expected.amax()), "{} {}", caused, expected);
    }

    #[test]
    fn a_fixed_joint_takes_no_part(
        chain in chains::<4>(), q in vectors(2.0), qd in vectors(3.0), qdd in vectors(9.0),
        torque in vectors(5.0), gravity in in_space(10.0),
    ) {
        let mut joints = *chain.joints();
        joints[1].motion = ChainMotion::Fixed;
        let chain = Chain::new(*chain.base(), joints, *chain.bodies(), *chain.tip_point()).unwrap();
        let armature = Joints::<4>::zeros();
        let of = |value: f64| {
            let [mut q, mut qd, mut qdd, mut torque] = [q, qd, qdd, torque];
            for vector in [&mut q, &mut qd, &mut qdd, &mut torque] {
                vector[1] = value;
            }
            (
                chain.inverse_dynamics(&q, &qd, &qdd, &gravity),
                chain.forward_dynamics(&q, &qd, &torque, &gravity, &armature),
            )
        };
        let (taken, caused) = of(0.0);
        prop_assert_eq!(taken[1], 0.0);
        prop_assert_eq!(caused.unwrap()[1], 0.0);
        prop_assert_eq!(of(7.0), (taken, caused));
        prop_assert_eq!(chain.mass_matrix(&q).row(1).amax(), 0.0);
    }
}

/// One step of the classical Runge-Kutta method.
fn step<const N: usize>(
    model: &impl Dynamics<N>,
    (q, qd): (Joints<N>, Joints<N>),
    torque: &Joints<N>,
    gravity: &Vector3<f64>,
    dt: f64,
) -> (Joints<N>, Joints<N>) {
    let none = Joints::<N>::zeros();
    let rates = |q: Joints<N>, qd: Joints<N>| {
        let qdd = model.forward_dynamics(&q, &qd, torque, gravity, &none);
        (qd, qdd.unwrap())
    };
    let first = rates(q, qd);
    let second = rates(q + first.0 * (dt / 2.0), qd + first.1 * (dt / 2.0));
    let third = rates(q + second.0 * (dt / 2.0), qd + second.1 * (dt / 2.0));
    let fourth = rates(q + third.0 * dt, qd + third.1 * dt);
    (
        q + (first.0 + (second.0 + third.0) * 2.0 + fourth.0) * (dt / 6.0),
        qd + (first.1 + (second.1 + third.1) * 2.0 + fourth.1) * (dt / 6.0),
    )
}

/// The energy of a motion under constant torques grows by their work, and by nothing else.
fn keeps_energy<const N: usize>(
    model: &impl Dynamics<N>,
    chain: &Chain<N>,
    start: Joints<N>,
    torque: &Joints<N>,
    steps: u32,
    dt: f64,
) {
    let gravity = Vector3::new(1.0, -2.0, -9.0);
    let none = Joints::<N>::zeros();
    let before = potential(chain, &start, &gravity);
    let (mut q, mut qd) = (start, none);
    let mut most = 0.0_f64;
    for _ in 0..steps {
        (q, qd) = step(model, (q, qd), torque, &gravity, dt);
        most = max(most, 0.5 * qd.dot(&(model.mass_matrix(&q) * qd)));
    }
    let after = potential(chain, &q, &gravity) + kinetic(chain, &q, &qd);
    let work = torque.dot(&(q - start));
    let lost = (after - before - work).abs() / most;
    assert!(lost < 1e-8, "{lost} of {most} J");
}

#[test]
fn a_finger_that_falls_keeps_its_energy() {
    let hand = geometry();
    let (finger, chain) = (hand.finger(3), hand.chain(3));
    let start = Vector4::new(0.1, 0.4, 0.3, 0.2);
    for torque in [Vector4::zeros(), Vector4::new(1e-4, 2e-3, -1e-3, 2e-4)] {
        keeps_energy(&finger, &chain, start, &torque, 2000, 1e-4);
        keeps_energy(&chain, &chain, start, &torque, 2000, 1e-4);
    }
}

#[test]
fn a_chain_that_turns_and_slides_keeps_its_energy() {
    let tilt = Rotation3::new(Vector3::new(0.4, -0.2, 0.3)).into_inner();
    let joint = |z, motion| {
        ChainJoint::new(
            Pose {
                rotation: tilt,
                position: Vector3::new(0.05, 0.0, z),
            },
            motion,
        )
    };
    let chain = Chain::new(
        Pose::at(0.0, 0.0, 1.0),
        [
            joint(0.1, ChainMotion::Revolute(Vector3::z())),
            joint(0.2, ChainMotion::Fixed),
            joint(0.1, ChainMotion::Prismatic(Vector3::x())),
            joint(0.3, ChainMotion::Revolute(Vector3::y())),
            joint(0.2, ChainMotion::Revolute(Vector3::x())),
        ],
        [ChainBody {
            mass: 0.8,
            center: Vector3::new(0.02, -0.01, 0.1),
            inertia: Matrix3::new(0.025, 1e-3, 0.0, 1e-3, 0.03, 2e-3, 0.0, 2e-3, 0.015),
        }; 5],
        Vector3::zeros(),
    )
    .unwrap();
    let start = Joints::<5>::new(0.3, 0.0, 0.1, -0.4, 0.5);
    let torque = Joints::<5>::new(0.1, 0.0, -2.0, 0.3, 0.05);
    keeps_energy(&chain, &chain, start, &torque, 500, 1e-3);
}
