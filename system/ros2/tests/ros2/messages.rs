use condor_ros2::{
    DecodeError, JointState, Level, Log, RosMessage, StringMessage, TFMessage, Time, Transform,
    encode, schema,
};
use proptest::prelude::*;

#[test]
fn a_joint_state_has_the_bytes_of_ros() {
    let state = JointState {
        stamp: Time { sec: 1, nanosec: 2 },
        names: &["a".into(), "bcde".into()],
        positions: &[1.0, -0.5],
        velocities: &[],
        efforts: &[2.0],
    };
    let expected: [&[u8]; 12] = [
        &[0, 1, 0, 0],
        &[1, 0, 0, 0, 2, 0, 0, 0],
        // The frame, empty, and what aligns the number of names.
        &[1, 0, 0, 0, 0, 0, 0, 0],
        &[2, 0, 0, 0],
        &[2, 0, 0, 0, b'a', 0, 0, 0],
        &[5, 0, 0, 0, b'b', b'c', b'd', b'e', 0, 0, 0, 0],
        // A number of elements, and what aligns the elements.
        &[2, 0, 0, 0, 0, 0, 0, 0],
        &1.0_f64.to_le_bytes(),
        &(-0.5_f64).to_le_bytes(),
        &[0, 0, 0, 0],
        &[1, 0, 0, 0],
        &2.0_f64.to_le_bytes(),
    ];
    assert_eq!(encode(&state), expected.concat());
}

#[test]
fn a_transform_has_the_bytes_of_ros() {
    let transforms = [Transform {
        parent: "palm".into(),
        child: "tip".into(),
        translation: [1.0, 2.0, 3.0],
        rotation: [0.0, 0.0, 0.0, 1.0],
    }];
    let message = TFMessage {
        stamp: Time { sec: 7, nanosec: 8 },
        transforms: &transforms,
    };
    let numbers = [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0].map(f64::to_le_bytes);
    let expected: [&[u8]; 6] = [
        &[0, 1, 0, 0],
        &[1, 0, 0, 0, 7, 0, 0, 0, 8, 0, 0, 0],
        &[5, 0, 0, 0, b'p', b'a', b'l', b'm', 0, 0, 0, 0],
        &[4, 0, 0, 0, b't', b'i', b'p', 0],
        &[],
        numbers.as_flattened(),
    ];
    assert_eq!(encode(&message), expected.concat());
}

#[test]
fn a_text_has_the_bytes_of_ros() {
    let expected = [0, 1, 0, 0, 5, 0, 0, 0, b'<', 0xc3, 0xb8, b'>', 0];
    assert_eq!(encode(&StringMessage("<ø>")), expected);
    assert_eq!(schema::<StringMessage<'_>>(), "string data\n");
}

#[test]
fn a_schema_has_each_type_on_which_it_depends_once() {
    let text = schema::<TFMessage<'_>>();
    let separator = format!("{}\n", "=".repeat(80));
    let mut parts = text.split(&separator);
    assert_eq!(parts.next(), Some(TFMessage::DEFINITION));
    let names: Vec<_> = parts.map(|part| part.lines().next().unwrap()).collect();
    let expected = [
        "MSG: geometry_msgs/TransformStamped",
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
        "MSG: geometry_msgs/Transform",
        "MSG: geometry_msgs/Vector3",
        "MSG: geometry_msgs/Quaternion",
    ];
    assert_eq!(names, expected);
}

#[test]
fn times_outside_of_the_type_are_its_ends() {
    assert_eq!(Time::from_ns(u64::MAX).sec, i32::MAX);
    let before = Time {
        sec: -1,
        nanosec: 5,
    };
    assert_eq!(before.as_ns(), 0);
}

fn logs() -> impl Strategy<Value = Log> {
    let levels = [
        Level::Debug,
        Level::Info,
        Level::Warn,
        Level::Error,
        Level::Fatal,
    ];
    let level = proptest::sample::select(levels.to_vec());
    (0..i32::MAX, 0..1_000_000_000_u32, level, ".*", ".*").prop_map(
        |(sec, nanosec, level, name, text)| Log {
            stamp: Time { sec, nanosec },
            level,
            name,
            text,
        },
    )
}

proptest! {
    #[test]
    fn a_log_is_read_as_it_was_written(log in logs()) {
        let bytes = encode(&log);
        prop_assert_eq!(Time::from_ns(log.stamp.as_ns()), log.stamp);
        prop_assert_eq!(Log::decode(&bytes), Ok(log));
    }

    #[test]
    fn half_a_log_is_an_error(log in logs(), cut: proptest::sample::Index) {
        let bytes = encode(&log);
        // Behind the text there are two empty texts and a number, which are not read.
        let read = 4 + 8 + 4 + (4 + log.name.len() + 1).next_multiple_of(4) + 4 + log.text.len() + 1;
        let is_error = matches!(
            Log::decode(&bytes[..cut.index(read)]),
            Err(DecodeError::Short { .. } | DecodeError::Header { .. })
        );
        prop_assert!(is_error);
        prop_assert_eq!(Log::decode(&bytes[..read]), Ok(log));
    }

    #[test]
    fn any_bytes_are_a_log_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
        let bytes = [&[0, 1, 0, 0], bytes.as_slice()].concat();
        let _ = Log::decode(&bytes);
    }
}
