use condor_hand::kinematics::Kinematics;
use condor_host::robot::Robot;
use condor_scene::{Ball, HandView};
use nalgebra::{SVector, Vector3};

use crate::utah_mit;

const BALL: Ball<'_> = Ball {
    center: ["x", "y", "z"],
    radius_m: "radius",
    touching: "touching",
};

#[test]
fn contacts_are_on_the_ball_towards_the_tips() {
    let hand = utah_mit();
    let view = HandView::new(&hand).with_ball(&BALL);
    let touch = ["index.touch", "middle.touch", "ring.touch", "thumb.touch"];
    let all = [&["x", "y", "z", "radius", "touching"][..], &touch].concat();
    assert_eq!(view.observed(), all);
    let positions = [0.1, 0.2, 0.9, 0.8].repeat(4);
    let observed = [
        0.08,
        0.01,
        -0.06,
        0.02,
        0b1001.into(),
        1.5,
        2.5,
        3.5,
        f64::NAN,
    ];
    let objects = view.objects(&positions, &observed);
    let [ball] = &objects[..] else {
        panic!("{objects:?}");
    };
    assert_eq!((ball.center, ball.radius_m), ([0.08, 0.01, -0.06], 0.02));
    let told: Vec<_> = ball
        .contacts
        .iter()
        .map(|it| (&*it.name, it.force_n))
        .collect();
    assert_eq!(told, [("index", Some(1.5)), ("thumb", None)]);
    let center = Vector3::from(ball.center);
    for contact in &ball.contacts {
        let finger = hand
            .fingers
            .iter()
            .find(|it| *it.name == contact.name)
            .unwrap();
        let own = SVector::<f64, 4>::from_column_slice(&positions[..4]);
        let (tip, at) = (
            finger.chain().tip(&own).position - center,
            Vector3::from(contact.point) - center,
        );
        assert!((at.normalize() - Vector3::from(contact.normal)).norm() < 1e-12);
        assert!((at.norm() - 0.02).abs() < 1e-12);
        assert!(at.cross(&tip).norm() < 1e-12 && at.dot(&tip) > 0.0);
    }
}

#[test]
fn without_a_ball_nothing_is_held() {
    let hand = utah_mit();
    let view = HandView::new(&hand).with_ball(&BALL);
    for observed in [
        [f64::NAN, 0.0, 0.0, 0.02, 1.0],
        [0.1, 0.0, 0.0, f64::INFINITY, 1.0],
    ] {
        assert_eq!(view.objects(&[], &observed), []);
    }
    assert_eq!(view.objects(&[], &[]), []);
    // More bits than fingers, and none that is a number.
    for (touching, expected) in [(1e300, 4), (f64::NAN, 0), (-1.0, 0)] {
        let [ball] = &view.objects(&[], &[0.1, 0.0, 0.0, 0.02, touching])[..] else {
            panic!("{touching}");
        };
        assert_eq!(ball.contacts.len(), expected);
    }
}
