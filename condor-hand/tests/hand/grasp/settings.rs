//! What a grasp is to be like: as text, as bytes, and as an order about a ball that was measured.

use condor_hand::ImageError;
use condor_hand::grasp::GraspError;
use condor_hand::grasp::distributed::{GraspAxes, GraspSettings, MeasuredBall};
use nalgebra::{Matrix6, Rotation3, UnitQuaternion, Vector3, Vector6, vector};

const TEXT: &str = "\
# A grasp.
stiffness = [
    [200,   20.0,   0.0, 0.0,  0.5,   0.3],
    [ 20.0, 160.0, -15.0, -0.5, 0.0,  0.2],
    [  0.0, -15.0, 240.0, 0.4,  0.0,  0.0],
    [  0.0,  -0.5,   0.4, 0.1,  0.01, 0.0],
    [  0.5,   0.0,   0.0, 0.01, 0.12, -0.01],
    [  0.3,   0.2,   0.0, 0.0, -0.01, 0.08],
]
damping = 0.01
axes = \"object\"
mass_kg = 0.05
squeeze_n = 2
friction = 0.7
";

fn read(text: &str) -> Result<GraspSettings, String> {
    GraspSettings::from_toml(text, "it.toml").map_err(|error| error.to_string())
}

#[test]
fn a_text_has_the_whole_matrix_or_its_diagonal() {
    let settings = read(TEXT).unwrap();
    assert_eq!(settings.stiffness[0], [200.0, 20.0, 0.0, 0.0, 0.5, 0.3]);
    assert_eq!(settings.stiffness[5][4], -0.01);
    assert_eq!(settings.damping[2], [0.0, -0.15, 2.4, 0.004, 0.0, 0.0]);
    assert_eq!(settings.axes, GraspAxes::Object);
    assert_eq!((settings.mass_kg, settings.squeeze_n), (0.05, 2.0));
    assert_eq!((settings.friction, settings.ramp_s), (0.7, 1.0));
    let gains = [200.0, 250.0, 150.0, 0.1, 0.2, 0.3];
    let short = read("stiffness = [200, 250, 150, 0.1, 0.2, 0.3]").unwrap();
    let damping = gains.map(|gain| gain * 0.02);
    assert_eq!(short, GraspSettings::diagonal(gains, damping));
    let damped = read("stiffness = [1, 1, 1, 1, 1, 1]\ndamping = [1, 2, 3, 4, 5, 6]").unwrap();
    assert_eq!(damped.damping[4], [0.0, 0.0, 0.0, 0.0, 5.0, 0.0]);
}

#[test]
fn mistakes_are_told_with_their_lines_and_columns() {
    let change = |from: &str, to: &str| {
        assert!(TEXT.contains(from), "{from}");
        read(&TEXT.replacen(from, to, 1)).unwrap_err()
    };
    for (error, begins) in [
        (
            change("0.4, 0.1,", "0.3, 0.1,"),
            "it.toml:2:13: the gains are not symmetric: 0.4 in row 3, column 4, is not 0.3 in row 4, column 3; make them the same",
        ),
        (
            change("160.0", "-160.0"),
            "it.toml:2:13: the gain along y that the other axes leave is -160; it must be at least 0",
        ),
        (
            change("0.0, -0.01, 0.08", "0.0, -0.01"),
            "it.toml:2:13: row 6 has 5 numbers; it must have 6",
        ),
        (
            change("    [  0.3,   0.2,   0.0, 0.0, -0.01, 0.08],\n", ""),
            "it.toml:2:13: the matrix has 5 rows; it must have 6",
        ),
        (
            change("[200, ", "[inf, "),
            "it.toml:2:13: a gain of the object is inf; it must be finite",
        ),
        (
            change("[200, ", "[\"soft\", "),
            "it.toml:2:13: gains must be six numbers, the diagonal of a matrix, or six rows of six numbers",
        ),
        (
            change("damping = 0.01", "damping = -1"),
            "it.toml:10:11: the time of the damping is -1 s; it must be at least 0",
        ),
        (
            change("mass_kg = 0.05", "mass_kg = -0.05"),
            "it.toml:12:11: the mass of the object, kg, is -0.05; it must be at least 0",
        ),
        (change("squeeze_n = 2", "squeeze_n = -2"), "it.toml:13:13: "),
        (change("\"object\"", "\"world\""), "it.toml:11:8: "),
        (
            change("friction", "fricton"),
            "it.toml:14:1: there is no key `fricton` here; did you mean `friction`?",
        ),
        (
            read("stiffness = 200").unwrap_err(),
            "it.toml:1:13: a number stands where a matrix of six rows, or its diagonal, should be",
        ),
        (
            read("stiffness = [1, 1, 1, 1, 1, [1]]").unwrap_err(),
            "it.toml:1:13: gains must be six numbers, the diagonal of a matrix, or six rows of six numbers",
        ),
        (
            read("mass_kg = 1").unwrap_err(),
            "it.toml:1:1: the key `stiffness` is missing here",
        ),
    ] {
        assert!(error.starts_with(begins), "{error}\nis not\n{begins}");
    }
    // Coupled more than two axes can be.
    let error = change("20.0,   0.0, 0.0,  0.5", "200.0,   0.0, 0.0,  0.5");
    assert!(
        error.contains("200 in row 1, column 2, is not 20 in row 2, column 1"),
        "{error}"
    );
    let coupled = TEXT.replace("20.0, ", "200.0, ");
    assert!(
        read(&coupled)
            .unwrap_err()
            .contains("that the other axes leave")
    );
}

#[test]
fn an_image_is_read_back_and_every_changed_byte_is_noticed() {
    let settings = read(TEXT).unwrap();
    let mut bytes = [0; GraspSettings::IMAGE_BYTES];
    let len = settings.to_image(&mut bytes).unwrap();
    assert_eq!(len, bytes.len());
    assert_eq!(bytes[..6], *b"CNDG\x01\x00");
    assert_eq!(GraspSettings::from_image(&bytes), Ok(settings));
    for place in 0..len {
        let mut changed = bytes;
        changed[place] ^= 0x10;
        assert!(GraspSettings::from_image(&changed).is_err(), "{place}");
    }
    for short in [0, 3, 20, len - 1] {
        assert!(GraspSettings::from_image(&bytes[..short]).is_err());
    }
    assert!(matches!(
        settings.to_image(&mut bytes[..100]),
        Err(ImageError::BufferTooShort { len: 100 })
    ));
    let mut wrong = settings;
    wrong.damping[3][3] = -1.0;
    assert!(matches!(
        wrong.to_image(&mut bytes),
        Err(ImageError::Content {
            error: GraspError::Number(_),
            ..
        })
    ));
}

#[test]
fn an_order_is_about_the_ball_as_it_was_measured() {
    let settings = read(TEXT).unwrap();
    let turn = UnitQuaternion::from_scaled_axis(vector![0.3, -0.5, 0.9]);
    let middle = vector![0.08, 0.01, -0.06];
    let ball = MeasuredBall::new(middle.into(), [turn.w, turn.i, turn.j, turn.k], 0.02);
    let tips = [
        [0.08, 0.05, -0.06],
        [0.11, 0.01, -0.06],
        [0.08, 0.01, -0.06],
    ];
    let order = settings.order(0b11, &tips, &ball, &[0.0, 0.0, -10.0]);
    assert_eq!(order.fingers, 0b11);
    assert_eq!(order.center, [0.08, 0.01, -0.06]);
    assert_eq!(order.force, [0.0, 0.0, 0.5]);
    assert_eq!((order.squeeze_n, order.friction), (2.0, 0.7));
    for (tip, to) in order.tips.iter().zip([
        vector![0.08, 0.03, -0.06],
        vector![0.10, 0.01, -0.06],
        // Nowhere is nearer than anywhere else.
        middle,
    ]) {
        assert!((Vector3::from(*tip) - to).norm() < 1e-15);
    }
    // What the spring does to the ball does not depend on the axes in which it is seen.
    let rotation = Rotation3::from(turn);
    let away = Vector6::new(1e-3, -2e-3, 3e-3, 0.01, 0.02, -0.03);
    let turned = |vector: &Vector6<f64>| {
        let along = rotation * vector.fixed_rows::<3>(0).into_owned();
        let about = rotation * vector.fixed_rows::<3>(3).into_owned();
        Vector6::new(along.x, along.y, along.z, about.x, about.y, about.z)
    };
    for (given, ordered) in [
        (&settings.stiffness, &order.stiffness),
        (&settings.damping, &order.damping),
    ] {
        let wanted = turned(&(Matrix6::from(*given) * away));
        let found = Matrix6::from(*ordered) * turned(&away);
        assert!((wanted - found).amax() < 1e-12);
    }
    let palm = GraspSettings {
        axes: GraspAxes::Palm,
        ..settings
    };
    let order = palm.order(0b11, &tips, &ball, &[0.0; 3]);
    assert_eq!(order.stiffness, settings.stiffness);
}
