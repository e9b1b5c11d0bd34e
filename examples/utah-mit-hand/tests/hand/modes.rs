//! Modes of joints, typed at the master's terminal, in virtual time.

use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::Kinematics;
use nalgebra::{SVector, Vector3};

use crate::typist::{Typist, hand, run};

const JOINTS: [&str; 4] = ["abduction", "proximal", "middle", "distal"];
const KILOGRAMS: f64 = 0.05;

/// The index finger at rest in the motion `open`, and enabled.
fn opened(typist: &mut Typist<'_>) {
    typist.begin();
    typist.does("enable");
    typist.wait(1.0);
    typist.runs("open");
    typist.wait(0.5);
}

/// The torques by which the tendons hold the index finger where it is, with a weight on its tip, N m.
fn balance(typist: &Typist<'_>, kilograms: f64) -> [f64; 4] {
    let hand = hand();
    let mechanism = hand.fingers[0].planar().unwrap();
    let q = SVector::from(typist.truth().position[0]);
    let gravity = Vector3::from(hand.gravity);
    let (_, jacobian) = mechanism.kinematics(&q);
    let weight = jacobian.fixed_rows::<3>(0).transpose() * (gravity * kilograms);
    (mechanism.gravity_torque(&q, &gravity) - weight).into()
}

/// How far the joints of the index finger go from where they are, within so many seconds, rad.
fn strays(typist: &mut Typist<'_>, seconds: f64) -> [f64; 4] {
    let from = typist.truth().position[0];
    typist.is.clear();
    typist.wait(seconds);
    let mut farthest = [0.0; 4];
    for is in &typist.is {
        for (far, (is, from)) in farthest.iter_mut().zip(is[0].iter().zip(from)) {
            *far = condor_hand::math::max(*far, (is - from).abs());
        }
    }
    farthest
}

#[test]
fn torque_mode_holds_a_weight() {
    run(|typist| {
        opened(typist);
        // While the joints hold their positions, somebody hangs the weight on the fingertip.
        typist.does(&format!("weight index {KILOGRAMS}"));
        typist.wait(1.0);
        let torques = balance(typist, KILOGRAMS);
        for joint in 1..4 {
            let (name, torque) = (JOINTS[joint], torques[joint]);
            typist.does(&format!("torque index.{name} {torque:.4}"));
        }
        let status = typist.says("status");
        assert!(
            status.contains("index: torque proximal middle distal; position abduction\n"),
            "{status}"
        );
        assert!(status.contains("index  mixed"), "{status}");
        let held = strays(typist, 5.0);
        println!("held within {held:?} rad by {torques:?} N m");
        assert!(held.iter().all(|&far| far < 0.02), "{held:?}");

        // Without the weight the same torques lift the finger, and with the weight alone it falls.
        let held = typist.truth().position[0][1];
        typist.does("weight index 0");
        typist.wait(0.5);
        let lifted = held - typist.truth().position[0][1];
        println!("lifted by {lifted} rad");
        assert!(lifted > 0.1, "{lifted}");
        typist.does("enable index");
        typist.runs("open");
        typist.does(&format!("weight index {KILOGRAMS}"));
        typist.wait(0.5);
        let links = balance(typist, 0.0);
        for joint in 1..4 {
            let (name, torque) = (JOINTS[joint], links[joint]);
            typist.types(&format!("torque index.{name} {torque:.4}"));
        }
        let fallen = strays(typist, 0.7);
        println!("fell by {fallen:?} rad");
        assert!(fallen[1] > 0.3, "{fallen:?}");
    });
}

#[test]
fn efforts_that_are_typed_are_there_and_a_spring_gives_as_its_stiffness_says() {
    run(|typist| {
        opened(typist);
        typist.does("effort index.distal-flexor 9");
        typist.does("effort index.distal-extensor 8.5");
        typist.wait(0.5);
        for _ in 0..20 {
            typist.wait(0.05);
            let [.., flexor, extensor] = typist.truth().effort[0];
            assert!((flexor - 9.0).abs() < 0.1, "{flexor} N");
            assert!((extensor - 8.5).abs() < 0.1, "{extensor} N");
        }
        typist.does("mode index.distal position");
        assert!(typist.says("status").contains("index  follows"));

        let (stiffness, position) = (0.4, 0.6);
        typist.does(&format!(
            "impedance index.proximal {stiffness} 0.012 {position}"
        ));
        typist.wait(2.0);
        let is = typist.truth().position[0][1];
        assert!((is - position).abs() < 0.01, "{is} rad");
        for kilograms in [0.02, 0.06] {
            typist.says(&format!("weight index {kilograms}"));
            typist.wait(3.0);
            let load = balance(typist, 0.0)[1] - balance(typist, kilograms)[1];
            let moved = typist.truth().position[0][1] - position;
            println!("{load} N m: {moved} rad");
            assert!(
                (moved * stiffness / load - 1.0).abs() < 0.03,
                "{load} N m moved it by {moved} rad"
            );
        }
        typist.says("weight index 0");
        // All of them, about where they are.
        let before = typist.truth().position[2];
        typist.does("impedance ring 0.05");
        typist.wait(1.0);
        for (before, after) in before.iter().zip(typist.truth().position[2]) {
            assert!((before - after).abs() < 0.01, "{before} to {after} rad");
        }
        assert!(typist.says("status").contains("ring   impedance"));
    });
}

#[test]
fn modes_keep_what_a_joint_has() {
    run(|typist| {
        opened(typist);
        for (mode, shown) in [
            ("torque", "by torque"),
            ("impedance", "impedance"),
            ("effort", "by effort"),
            ("position", "follows"),
            ("impedance", "impedance"),
        ] {
            let before = typist.truth().position[0];
            typist.types(&format!("mode index {mode}"));
            typist.wait(0.1);
            let after = typist.truth().position[0];
            let status = typist.says("status");
            assert!(status.contains(&format!("index  {shown}")), "{status}");
            for (before, after) in before.iter().zip(after) {
                let moved = (before - after).abs();
                assert!(moved < 0.03, "{moved} rad by {mode}");
            }
        }
        // The other fingers are not held up.
        typist.does("to ring.middle 0.9 1");
        typist.wait(1.0);
        typist.does("enable index");
        assert!(typist.runs("open") < 2.5);
    });
}
