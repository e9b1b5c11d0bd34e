//! Grasps whose answers can be found with a pencil.

use condor_hand::grasp::{
    ContactFriction, Contacts, GraspError, Normals, SpatialGain, Squeeze, Twist, Wrench,
};
use condor_hand::{NumberError, Requirement, Subject};
use nalgebra::{Matrix6, Vector3, vector};

use super::wrenches::{difference, wrench_of};

const ORIGIN: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);

fn pull(force: Vector3<f64>, moment: Vector3<f64>) -> Wrench {
    Wrench { force, moment }
}

#[test]
fn a_force_between_two_tips_leaves_the_third_without_load() {
    let tips = [
        vector![0.02, 0.0, 0.0],
        vector![-0.02, 0.0, 0.0],
        vector![0.0, 0.02, 0.0],
    ];
    let lift = pull(vector![0.0, 0.0, 3.0], ORIGIN);
    let held = Contacts::new(tips).unwrap().forces(&lift, &ORIGIN).unwrap();
    let up = vector![0.0, 0.0, 1.5];
    assert!(difference(&held.forces, &[up, up, ORIGIN]) < 1e-15);
    assert_eq!(held.lost_moment, ORIGIN);
}

#[test]
fn two_tips_lose_the_moment_about_their_line() {
    let tips = [vector![-0.03, 0.01, 0.0], vector![0.03, 0.01, 0.0]];
    let contacts = Contacts::new(tips).unwrap();
    let asked = pull(vector![0.0, 0.0, 2.0], vector![0.05, 0.0, 0.006]);
    let held = contacts.forces(&asked, &ORIGIN).unwrap();
    // 2 N at y = 0.01 turn by 0.02 about x: that much of the moment is made, the rest is lost.
    assert!((held.lost_moment - vector![0.03, 0.0, 0.0]).norm() < 1e-16);
    let forces = [vector![0.0, -0.1, 1.0], vector![0.0, 0.1, 1.0]];
    assert!(difference(&held.forces, &forces) < 1e-15);
}

#[test]
fn one_tip_bears_a_force_through_it_and_nothing_else() {
    let contacts = Contacts::new([vector![0.01, 0.02, 0.03]]).unwrap();
    let force = vector![1.0, -2.0, 0.5];
    let moment = vector![0.01, 0.02, 0.03].cross(&force);
    let held = contacts.forces(&pull(force, moment), &ORIGIN).unwrap();
    assert_eq!(held.forces, [force]);
    assert_eq!(held.lost_moment, ORIGIN);
    let twisted = moment + vector![0.0, 0.0, 1e-6];
    let refused = contacts.forces(&pull(force, twisted), &ORIGIN).unwrap_err();
    let refused = number(refused);
    assert!((refused.value - 1e-6).abs() < 1e-15);
    assert_eq!(refused.must, Requirement::Equal(0.0));
}

fn number(error: GraspError) -> NumberError {
    match error {
        GraspError::Number(error) => error,
        other => panic!("{other}"),
    }
}

#[test]
fn contacts_that_cannot_hold_are_refused_with_their_numbers() {
    let line = [ORIGIN, vector![0.01, 0.0, 0.0], vector![0.03, 1e-9, 0.0]];
    let refused = number(Contacts::new(line).unwrap_err());
    assert!(refused.value < 1e-9 && refused.must == Requirement::Above(1e-9));
    let point = [vector![0.01, 0.02, 0.03]; 4];
    let refused = number(Contacts::new(point).unwrap_err());
    assert_eq!((refused.at, refused.value), (Subject::Contact(1), 0.0));
    let refused = number(Contacts::new([vector![0.1, 0.0, 0.0]; 2]).unwrap_err());
    assert_eq!(refused.at, Subject::Contact(1));
    let Err(refused) = Contacts::new([ORIGIN, vector![0.0, f64::NAN, 0.0], ORIGIN]) else {
        panic!("no point");
    };
    assert_eq!(
        refused.to_string(),
        "finger 1: the position of the tip, m, is NaN; it must be finite"
    );
    let Err(refused) = Contacts::<0>::new([]) else {
        panic!("no contacts");
    };
    assert_eq!(
        refused.to_string(),
        "the number of contacts is 0; it must be at least 1"
    );
    // Two of four contacts at one place still hold, but cannot press on each other.
    let double = [
        ORIGIN,
        ORIGIN,
        vector![0.02, 0.0, 0.0],
        vector![0.0, 0.02, 0.0],
    ];
    let contacts = Contacts::new(double).unwrap();
    let refused = contacts
        .internal_forces(&Squeeze::equal(1.0).unwrap())
        .unwrap_err();
    assert_eq!(
        refused.to_string(),
        "contact 1: its distance from another contact, m, is 0; it must be above 0"
    );
    let edge = Squeeze::none().with_edge(2, 1, 1.0).unwrap();
    assert!(contacts.internal_forces(&edge).is_ok());
}

#[test]
fn a_squeeze_pushes_both_ends_of_an_edge() {
    let tips = [ORIGIN, vector![0.04, 0.0, 0.0], vector![0.0, 0.03, 0.0]];
    let contacts = Contacts::new(tips).unwrap();
    let squeeze = Squeeze::none()
        .with_edge(0, 1, 2.0)
        .unwrap()
        .with_edge(2, 1, 5.0)
        .unwrap();
    let forces = contacts.internal_forces(&squeeze).unwrap();
    let expected = [
        vector![2.0, 0.0, 0.0],
        vector![-6.0, 3.0, 0.0],
        vector![4.0, -3.0, 0.0],
    ];
    assert!(difference(&forces, &expected) < 1e-14);
    let none = wrench_of(&tips, &forces, &vector![1.0, 2.0, 3.0]);
    assert!(none.force.norm() + none.moment.norm() < 1e-14);
    for (first, second, force, told) in [
        (
            0,
            0,
            1.0,
            "the number of contacts of an edge is 1; it must be 2",
        ),
        (
            2,
            2,
            1.0,
            "the number of contacts of an edge is 1; it must be 2",
        ),
        (
            5,
            usize::MAX,
            1.0,
            "the number of a contact of an edge is 4294967295; it must be below 3",
        ),
        (
            0,
            3,
            1.0,
            "the number of a contact of an edge is 3; it must be below 3",
        ),
        (
            0,
            1,
            -1.0,
            "the force of a squeeze, N, is -1; it must be at least 0",
        ),
        (
            0,
            1,
            f64::NAN,
            "the force of a squeeze, N, is NaN; it must be at least 0",
        ),
    ] {
        let refused = squeeze.with_edge(first, second, force).unwrap_err();
        assert_eq!(refused.to_string(), told);
    }
}

#[test]
fn the_edges_of_a_square_have_a_stress_of_their_own() {
    // The sides push and the diagonals would pull: no edge can pull, so a square has one pattern
    // of six forces less. The internal force that is missing is normal to it, of alternating sign.
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| vector![x, y, 0.0]);
    let contacts = Contacts::new(square).unwrap();
    let mut sides = Squeeze::none();
    let mut diagonals = Squeeze::none();
    for corner in 0..4 {
        sides = sides.with_edge(corner, (corner + 1) % 4, 1.0).unwrap();
    }
    for corner in 0..2 {
        diagonals = diagonals
            .with_edge(corner, corner + 2, 2.0_f64.sqrt())
            .unwrap();
    }
    let sides = contacts.internal_forces(&sides).unwrap();
    let diagonals = contacts.internal_forces(&diagonals).unwrap();
    assert!(difference(&sides, &diagonals) < 1e-15);
    let normal = [1.0, -1.0, 1.0, -1.0].map(|z| vector![0.0, 0.0, z]);
    let none = wrench_of(&square, &normal, &ORIGIN);
    assert_eq!(none, Wrench::zero());
}

#[test]
fn friction_is_measured_from_the_cone() {
    let normals = Normals::new([vector![0.0, 0.0, 3.0]]).unwrap();
    let force = [vector![3.0, 4.0, 12.0]];
    let point = ContactFriction::point(0.5).unwrap();
    assert_eq!(point.margins(&normals, &force).unwrap(), [1.0]);
    let pull = [vector![0.0, 0.0, -2.0]];
    assert_eq!(point.margins(&normals, &pull).unwrap(), [-1.0]);
    for refused in [0.0, -1.0, f64::NAN].map(ContactFriction::point) {
        assert!(matches!(refused, Err(GraspError::Number(_))));
    }
}

#[test]
fn gains_are_refused_that_are_no_spring() {
    let told = |matrix: Matrix6<f64>| SpatialGain::new(&matrix).unwrap_err();
    let diagonal = [200.0, 250.0, 150.0, 0.1, 0.1, 0.1];
    let spring = *SpatialGain::diagonal(diagonal).unwrap().matrix();
    assert_eq!(spring.diagonal().as_slice(), diagonal);
    let mut bent = spring;
    bent[(1, 3)] = 0.5;
    assert_eq!(
        told(bent),
        GraspError::NotSymmetric {
            row: 1,
            column: 3,
            value: 0.5,
            mirrored: 0.0
        }
    );
    bent = spring;
    bent[(4, 4)] = -0.1;
    assert_eq!(
        told(bent).to_string(),
        "the gain about y that the other axes leave is -0.1; it must be at least 0"
    );
    // The coupled block [[200, 6], [6, 0.1]] has the determinant -16.
    bent = spring;
    (bent[(0, 3)], bent[(3, 0)]) = (6.0, 6.0);
    assert!(number(told(bent)).value < 0.0);
    (bent[(0, 3)], bent[(3, 0)]) = (4.4, 4.4);
    assert!(SpatialGain::new(&bent).is_ok());
    bent = spring;
    (bent[(2, 2)], bent[(2, 5)], bent[(5, 2)]) = (0.0, 1e-3, 1e-3);
    assert!(number(told(bent)).value < 0.0);
    bent[(3, 2)] = f64::NAN;
    assert!(matches!(told(bent), GraspError::Number(_)));
    // Three axes that pairwise agree and together do not.
    let mut odd = Matrix6::identity();
    for (row, column, gain) in [(0, 1, 0.9), (1, 2, 0.9), (0, 2, -0.9)] {
        (odd[(row, column)], odd[(column, row)]) = (gain, gain);
    }
    assert!(number(told(odd)).value < 0.0);
    assert_eq!(SpatialGain::zero().times(&Twist::zero()), Wrench::zero());
}

#[test]
fn half_a_turn_is_seen_whole() {
    let tips = [
        vector![0.02, 0.0, 0.01],
        vector![-0.02, 0.0, 0.0],
        vector![0.0, 0.03, 0.0],
    ];
    let contacts = Contacts::new(tips).unwrap();
    let turned = tips.map(|tip| vector![-tip.x, -tip.y, tip.z]);
    let twist = contacts.rigid_motion(&turned, &ORIGIN).unwrap();
    assert!((twist.angular.norm() - std::f64::consts::PI).abs() < 1e-14);
    assert!(twist.angular.xy().norm() < 1e-14 && twist.linear.norm() < 1e-16);
    let line = [0.0, 1.0, 2.0].map(|x| vector![x, 0.0, 0.0]);
    let refused = contacts.rigid_motion(&line, &ORIGIN).unwrap_err();
    assert!(number(refused).what.contains("separation"));
}
