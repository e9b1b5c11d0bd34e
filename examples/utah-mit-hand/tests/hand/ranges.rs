//! Numbers that can only be a mistake are refused, and what is simulated stays in its workspace.

use condor_robot::plant::{PlantRefusal, PlantRequest};

use crate::rig;
use crate::typist::run;

#[test]
fn numbers_out_of_range_are_refused_with_their_range() {
    run(|typist| {
        typist.begin();
        assert_eq!(typist.says("enable"), "");
        for (line, said) in [
            (
                "ball 5",
                "word 2: the radius of the ball cannot be 5 m; it may be 0.005 to 0.04 m\n",
            ),
            (
                "ball 0.02 50",
                "word 3: the mass of the ball cannot be 50 kg; it may be 0.001 to 1 kg\n",
            ),
            (
                "ball 0.02 0.05 0 0 9",
                "word 6: the position of the ball cannot be 9 m; it may be -0.3 to 0.3 m\n",
            ),
            (
                "push 0 400 0",
                "word 3: the force cannot be 400 N; it may be -20 to 20 N\n",
            ),
            (
                "push 0 0 0 0 0 7",
                "word 7: the moment cannot be 7 N m; it may be -1 to 1 N m\n",
            ),
            (
                "letgo 999",
                "word 2: the time cannot be 999 s; it may be 0 to 60 s\n",
            ),
            (
                "weight index 99",
                "word 3: the weight cannot be 99 kg; it may be 0 to 1 kg\n",
            ),
            (
                "gains index.proximal bandwidth_hz 9999",
                "word 4: bandwidth_hz cannot be 9999; it may be 0 to 50\n",
            ),
        ] {
            let answer = typist.says(line);
            assert!(answer.starts_with(said), "{line}: {answer}");
        }
        // Nothing has happened to the hand.
        let status = typist.says("status");
        assert!(!status.contains("fault of"), "{status}");
        assert!(!status.contains("failed"), "{status}");
    });
}

#[test]
fn the_robot_trusts_nobody_who_asks() {
    rig::run(2.0, None, |master| {
        master.wait_for_all();
        let ball = |x, radius, mass| PlantRequest::PlaceBall {
            center: [x, 0.004, -0.0625],
            radius,
            mass,
        };
        let wrong = [
            ball(1e4, 0.02, 0.05),
            ball(0.085, 5.0, 0.05),
            ball(0.085, -0.02, 0.05),
            ball(0.085, 0.02, 99.0),
            ball(0.085, 0.02, f64::NAN),
            PlantRequest::PushTip {
                finger: 0,
                force: [0.0, 1e4, 0.0],
                moment: [0.0; 3],
            },
            PlantRequest::LetGo { seconds: -1.0 },
        ];
        for request in wrong {
            let response = master.ask_plant(&request);
            assert_eq!(response, Err(PlantRefusal::Number), "{request:?}");
        }
        assert!(master.truth().unwrap().ball[0].is_nan());
    });
}

#[test]
fn the_greatest_ball_leaves_the_hand_usable() {
    run(|typist| {
        typist.begin();
        assert_eq!(typist.says("enable"), "");
        assert_eq!(typist.says("ball 0.04 1"), "");
        typist.wait(1.0);
        assert_eq!(typist.says("ball none"), "");
        typist.says("clear");
        typist.wait(1.0);
        typist.says("enable");
        let status = typist.says("status");
        assert!(!status.contains("fault of"), "{status}");
        assert!(typist.runs("open") < 2.5);
    });
}

#[test]
fn a_ball_that_falls_out_of_the_workspace_is_taken_away() {
    run(|typist| {
        typist.begin();
        assert_eq!(typist.says("ball 0.02 0.05 0.3 0.3 0.3"), "");
        assert!(typist.truth().ball[0].is_finite());
        assert_eq!(typist.says("letgo 0"), "");
        for _ in 0..20 {
            typist.wait(0.1);
            let ball = typist.truth().ball;
            assert!(!ball.iter().any(|along| along.abs() > 1.0), "{ball:?}");
        }
        assert!(typist.truth().ball[0].is_nan());
    });
}
