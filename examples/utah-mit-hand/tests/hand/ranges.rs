//! Numbers that can only be a mistake are refused, and what is simulated stays in its workspace.

use condor_robot::plant::{PlantRefusal, PlantRequest};

use crate::rig;
use crate::typist::run;

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
        typist.does("enable");
        typist.does("ball 0.04 1");
        typist.wait(1.0);
        typist.does("ball none");
        typist.says("clear");
        typist.wait(1.0);
        typist.says("enable");
        let status = typist.says("status");
        assert!(!status.contains("has a fault"), "{status}");
        assert!(typist.runs("open") < 2.5);
    });
}

#[test]
fn a_ball_that_falls_out_of_the_workspace_is_taken_away() {
    run(|typist| {
        typist.begin();
        typist.does("ball 0.02 0.05 0.3 0.3 0.3");
        assert!(typist.truth().ball[0].is_finite());
        typist.does("letgo 0");
        for _ in 0..20 {
            typist.wait(0.1);
            let ball = typist.truth().ball;
            assert!(!ball.iter().any(|along| along.abs() > 1.0), "{ball:?}");
        }
        assert!(typist.truth().ball[0].is_nan());
    });
}
