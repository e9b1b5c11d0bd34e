//! The posture of any chain that is nearest to a point.

#![allow(
    clippy::float_cmp,
    reason = "limits are met to the last bit, and the same sums are equal"
)]

use condor_hand::Pose;
use condor_hand::kinematics::{
    Chain, ChainBody, ChainJoint, ChainMotion, JointLimits, Kinematics, Nearest, Side,
};
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;

/// Three turning joints about different axes and a sliding one.
fn chain() -> Chain<4> {
    let joint = |x: f64, motion| ChainJoint::new(Pose::at(x, 0.0, 0.01), motion);
    Chain::new(
        Pose::at(0.1, 0.0, -0.02),
        [
            joint(0.0, ChainMotion::Revolute(Vector3::z())),
            joint(0.05, ChainMotion::Revolute(Vector3::y())),
            joint(0.08, ChainMotion::Prismatic(Vector3::x())),
            joint(0.03, ChainMotion::Revolute(Vector3::y())),
        ],
        [ChainBody::massless(); 4],
        Vector3::new(0.06, 0.0, 0.0),
    )
    .unwrap()
}

fn limits() -> JointLimits<4> {
    let upper = SVector::from([1.2, 1.5, 0.04, 1.4]);
    JointLimits::new(-upper, upper).unwrap()
}

fn posture(shares: [f64; 4]) -> SVector<f64, 4> {
    limits().upper().component_mul(&SVector::from(shares))
}

fn shares() -> impl Strategy<Value = [f64; 4]> {
    prop::array::uniform4(-1.0..=1.0_f64)
}

/// Checks what the answer says of itself, and that no free joint moves the tip nearer.
fn check(nearest: &Nearest<4>, target: &Vector3<f64>) -> Result<(), TestCaseError> {
    let (tip, jacobian) = chain().kinematics(&nearest.posture);
    let error = target - tip.position;
    prop_assert_eq!(nearest.distance, error.norm());
    prop_assert_eq!(limits().clamp(&nearest.posture), nearest.posture);
    let nearer = jacobian.fixed_rows::<3>(0).tr_mul(&error);
    let ranges = limits();
    for joint in 0..4 {
        let q = nearest.posture[joint];
        match nearest.held[joint] {
            Some(Side::Low) => prop_assert!(q == ranges.lower()[joint] && nearer[joint] < 0.0),
            Some(Side::High) => prop_assert!(q == ranges.upper()[joint] && nearer[joint] > 0.0),
            None => prop_assert!(
                nearer[joint].abs() <= 1e-6 * error.norm() + 1e-12,
                "joint {joint}: {nearer} with {error}"
            ),
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn a_small_step_within_reach_is_made(from in shares(), step in prop::array::uniform4(-0.1..=0.1_f64)) {
        let (chain, limits) = (chain(), limits());
        let from = posture(from);
        let target = chain.tip(&limits.clamp(&(from + posture(step)))).position;
        let nearest = chain.nearest(&target, &from, &limits).unwrap();
        prop_assert!(nearest.distance <= 1e-9, "{nearest:?}");
        prop_assert_eq!(nearest.held, [None; 4]);
        check(&nearest, &target)?;
    }

    #[test]
    fn out_of_reach_no_joint_can_do_better(
        from in shares(),
        target in prop::array::uniform3(-1.0..=1.0_f64),
    ) {
        let target = Vector3::from(target);
        let nearest = chain().nearest(&target, &posture(from), &limits()).unwrap();
        check(&nearest, &target)?;
    }

    #[test]
    fn whatever_the_numbers_are_the_posture_is_within_the_limits(
        from in prop::array::uniform4(any::<f64>()),
        target in prop::array::uniform3(any::<f64>()),
    ) {
        let (from, target) = (SVector::from(from), Vector3::from(target));
        match chain().nearest(&target, &from, &limits()) {
            Ok(nearest) => prop_assert_eq!(limits().clamp(&nearest.posture), nearest.posture),
            Err(error) => prop_assert!(!error.value.is_finite(), "{error}"),
        }
    }
}

#[test]
fn a_joint_that_slides_to_its_limit_holds_the_tip() {
    // Straight ahead of the finger, which lies along x.
    let straight = SVector::zeros();
    let tip = chain().tip(&straight).position;
    let ahead = tip + Vector3::x() * 0.02;
    let nearest = chain().nearest(&ahead, &straight, &limits()).unwrap();
    assert!(nearest.distance <= 1e-9 && (nearest.posture[2] - 0.02).abs() < 1e-2);
    let far = tip + Vector3::x() * 0.5;
    let nearest = chain().nearest(&far, &straight, &limits()).unwrap();
    assert_eq!(nearest.held, [None, None, Some(Side::High), None]);
    assert_eq!(nearest.posture[2], 0.04);
}

#[test]
fn a_part_of_a_chain_ends_at_the_origin_of_a_link() {
    let q = posture([0.3, -0.4, 0.5, 0.9]);
    let part = chain().up_to(2);
    // The third joint slides its own link, and the fourth is beyond it.
    let (tip, jacobian) = part.kinematics(&q);
    let mut other = q;
    other[3] = -1.0;
    assert_eq!(part.tip(&other), tip);
    assert_eq!(jacobian.column(3).amax(), 0.0);
    let whole = chain().tip(&q);
    let rest = Vector3::new(0.03, 0.0, 0.01);
    let fourth = tip.transform(&rest);
    // The tip turns about the fourth joint.
    assert!(((whole.position - fourth).norm() - 0.06).abs() < 1e-15);
}
