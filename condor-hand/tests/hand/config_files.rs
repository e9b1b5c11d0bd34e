//! A hand stays the same as an image, and on other wires.
#![cfg(feature = "text")]

use std::fmt::Write;
use std::sync::LazyLock;

use condor_hand::config::{
    Channel, Converter, EffortFaults, Form, Hand, InputChannel, Mistake, MistakeValue,
    OutputChannel, Rotation, Wire,
};
use condor_hand::servo::EffortGains;
use condor_hand::{ImageError, Subject};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

type Utah = Hand<4, 4, 8>;
type Tripod = Hand<3, 3, 6>;

const TEXT: &str = include_str!("../../hands/utah-mit.toml");

static UTAH: LazyLock<Utah> = LazyLock::new(|| Hand::from_toml(TEXT, "utah-mit.toml").unwrap());

static TRIPOD: LazyLock<Tripod> =
    LazyLock::new(|| Hand::from_toml(include_str!("../hands/tripod.toml"), "tripod.toml").unwrap());

static IMAGE: LazyLock<Vec<u8>> = LazyLock::new(|| image(&*TRIPOD));

fn image<const F: usize, const J: usize, const A: usize>(hand: &Hand<F, J, A>) -> Vec<u8> {
    let mut buffer = vec![0; 1 << 16];
    let len = hand.to_image(&mut buffer).unwrap();
    buffer.truncate(len);
    buffer
}

#[test]
fn an_image_gives_the_same_hand() {
    assert_eq!(Utah::from_image(&image(&*UTAH)).unwrap(), *UTAH);
    assert_eq!(Tripod::from_image(&image(&*TRIPOD)).unwrap(), *TRIPOD);
}

#[test]
fn an_image_does_not_depend_on_the_room_of_the_program() {
    let image = image(&*TRIPOD);
    let roomy = Hand::<7, 5, 8>::from_image(&image).unwrap();
    assert_eq!(self::image(&roomy), image);
    assert_eq!(
        Hand::<2, 3, 6>::from_image(&image),
        Err(ImageError::Count {
            of: "fingers",
            found: 3,
            wanted: 2
        })
    );
    assert_eq!(
        Hand::<3, 2, 6>::from_image(&image),
        Err(ImageError::Count {
            of: "joints in a finger",
            found: 3,
            wanted: 2
        })
    );
    assert_eq!(
        Hand::<3, 3, 5>::from_image(&image),
        Err(ImageError::Count {
            of: "actuators in a finger",
            found: 6,
            wanted: 5
        })
    );
}

#[test]
fn a_short_buffer_is_refused_at_any_length() {
    let len = image(&*TRIPOD).len();
    let mut buffer = vec![0; len];
    for len in 0..len {
        assert_eq!(
            TRIPOD.to_image(&mut buffer[..len]),
            Err(ImageError::BufferTooShort { len })
        );
    }
    assert_eq!(TRIPOD.to_image(&mut buffer), Ok(len));
}

#[test]
fn what_is_wrong_with_an_image_is_said() {
    let good = image(&*TRIPOD);
    let len = good.len();
    assert_eq!(
        Tripod::from_image(&good[..len - 1]),
        Err(ImageError::Length {
            needed: len,
            len: len - 1
        })
    );
    assert_eq!(
        Tripod::from_image(&[]),
        Err(ImageError::Length { needed: 20, len: 0 })
    );
    let mut long = good.clone();
    long.push(0);
    assert_eq!(
        Tripod::from_image(&long),
        Err(ImageError::Length {
            needed: len,
            len: len + 1
        })
    );
    let mut other = good.clone();
    other[0] = b'X';
    assert_eq!(
        Tripod::from_image(&other),
        Err(ImageError::Magic {
            found: *b"XNDH",
            wanted: *b"CNDH"
        })
    );
    let mut other = good.clone();
    other[4] = 5;
    assert_eq!(
        Tripod::from_image(&other),
        Err(ImageError::Version {
            found: 5,
            wanted: 7
        })
    );
    for byte in 6..len {
        let mut other = good.clone();
        other[byte] ^= 1;
        let error = Tripod::from_image(&other).unwrap_err();
        let lengths = matches!(error, ImageError::Length { .. });
        assert!(
            lengths || matches!(error, ImageError::Checksum { .. }),
            "{byte}: {error}"
        );
    }
}

/// Puts the right checksum into an image.
fn seal(image: &mut [u8]) {
    let mut crc = u32::MAX;
    for byte in image[..16].iter().chain(&image[20..]) {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(crc & 1));
        }
    }
    image[16..20].copy_from_slice(&(!crc).to_le_bytes());
}

#[test]
fn a_mistake_under_the_right_checksum_is_found() {
    let mut bytes = image(&*TRIPOD);
    let before = bytes.clone();
    seal(&mut bytes);
    assert_eq!(bytes, before);
    let mass = 0.015_f64.to_le_bytes();
    let place = bytes.windows(8).position(|window| window == mass).unwrap();
    bytes[place..place + 8].copy_from_slice(&(-0.015_f64).to_le_bytes());
    seal(&mut bytes);
    let error = Tripod::from_image(&bytes).unwrap_err();
    assert!(
        matches!(
            error,
            ImageError::Content {
                error: Mistake {
                    value: MistakeValue::Number(-0.015),
                    ..
                },
                ..
            }
        ),
        "{error}"
    );
    let mut bytes = before;
    bytes[6] = 2;
    seal(&mut bytes);
    assert_eq!(
        Tripod::from_image(&bytes),
        Err(ImageError::Malformed { at: Subject::Whole })
    );
}

#[test]
fn a_hand_without_fingers_or_processors_is_none() {
    let mut hand = TRIPOD.clone();
    hand.fingers.clear();
    let error = hand.check().unwrap_err();
    assert_eq!(
        error.to_string(),
        "`fingers` of the hand is empty; it must have one entry or more"
    );
    assert_eq!(hand.to_image(&mut [0; 4096]), Err(error.into()));
    hand.processors.clear();
    assert_eq!(
        hand.check().unwrap_err().to_string(),
        "`processors` of the hand is empty; it must have one entry or more"
    );
    let mut hand = UTAH.clone();
    hand.table.as_mut().unwrap().axes.clear();
    assert_eq!(
        hand.check().unwrap_err().to_string(),
        "`table.axes` of the hand is empty; it must have one entry or more"
    );
}

/// The text of the hand with other boards, channels and processors: nothing else is edited.
fn rewired(order: &[usize], boards: u8) -> String {
    let mut text = String::new();
    for line in TEXT.lines() {
        let mut line = line.to_owned();
        // Of a joint, or of an actuator.
        if line.starts_with("adc = { board = 0, ") || line.contains("}, dac = { board = ") {
            let mut rest = std::mem::take(&mut line);
            while let Some((before, after)) = rest.split_once("channel = ") {
                let (channel, after) = after.split_once(' ').unwrap();
                let channel = order[channel.parse::<usize>().unwrap()];
                write!(line, "{before}channel = {channel} ").unwrap();
                rest = after.to_owned();
            }
            line += &rest;
            line = line.replace("board = 0", &format!("board = {boards}"));
        } else if line.starts_with("joint_defaults = { processor = ") {
            line = line.replace('1', "9").replace('2', "1").replace('9', "2");
        }
        text += &line;
        text.push('\n');
    }
    text
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn a_wire_moves_by_an_edit_of_the_file_alone(
        order in Just((0..32).collect::<Vec<usize>>()).prop_shuffle(),
        board in 2_u8..,
    ) {
        let text = rewired(&order, board.max(3));
        let hand = Utah::from_toml(&text, "rewired").unwrap();
        for (finger, (now, before)) in hand.fingers.iter().zip(&UTAH.fingers).enumerate() {
            prop_assert_eq!(now.planar(), before.planar());
            prop_assert_eq!(now.chain(), before.chain());
            prop_assert_eq!(now.transmission(), before.transmission());
            prop_assert_eq!(now.limits(), before.limits());
            prop_assert_eq!(now.processor(), before.processor().map(|number| 3 - number));
            for (joint, entry) in before.joints.iter().enumerate() {
                let channel = Channel {
                    converter: Converter::Adc,
                    board: board.max(3),
                    channel: u8::try_from(order[usize::from(entry.adc.unwrap().channel)]).unwrap(),
                };
                prop_assert_eq!(hand.wire(channel), Some(Wire::Position { finger, joint }));
            }
        }
        for (_, wire) in UTAH.wires() {
            let calibration = |input: &InputChannel| (input.gain, input.offset, input.bits);
            prop_assert_eq!(hand.input(wire).map(calibration), UTAH.input(wire).map(calibration));
            let calibration = |output: &OutputChannel| (output.gain, output.offset, output.bits);
            prop_assert_eq!(hand.output(wire).map(calibration), UTAH.output(wire).map(calibration));
        }
        prop_assert_eq!(hand.wires().count(), UTAH.wires().count());
    }

    #[test]
    fn any_hand_stays_the_same_as_an_image(hand in hands()) {
        prop_assert_eq!(hand.check(), Ok(()));
        prop_assert_eq!(&Utah::from_image(&image(&hand)).unwrap(), &hand);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn no_bytes_make_the_reader_of_images_panic(bytes in vec(any::<u8>(), 0..200)) {
        prop_assert!(Tripod::from_image(&bytes).is_err());
    }

    /// Right checksums let bytes through to the reader and to the rules.
    #[test]
    fn what_an_image_gives_has_been_checked(
        edits in vec((any::<Index>(), any::<u8>()), 1..8),
        cut in proptest::option::weighted(0.2, any::<Index>()),
    ) {
        let mut bytes = IMAGE.clone();
        for (place, byte) in edits {
            let place = 20 + place.index(bytes.len() - 20);
            bytes[place] = byte;
        }
        if let Some(cut) = cut {
            bytes.truncate(20 + cut.index(bytes.len() - 20));
        }
        let len = u32::try_from(bytes.len() - 20).unwrap();
        bytes[12..16].copy_from_slice(&len.to_le_bytes());
        seal(&mut bytes);
        if let Ok(hand) = Tripod::from_image(&bytes) {
            prop_assert_eq!(hand.check(), Ok(()));
            prop_assert!(hand.fingers.iter().all(|finger| finger.transmission().is_ok()));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_text_makes_the_reader_panic(
        edits in vec((any::<Index>(), any::<Index>(), 0..30_usize), 1..6),
    ) {
        let mut text = TEXT.to_owned();
        for (from, source, len) in edits {
            let slice = |at: usize| at..(at + len).min(TEXT.len());
            let source = slice(source.index(TEXT.len()));
            let from = slice(from.index(text.len()));
            let from = from.start..from.end.min(text.len());
            if let (Some(new), Some(_)) = (TEXT.get(source), text.get(from.clone())) {
                text.replace_range(from, new);
            }
        }
        match Utah::from_toml(&text, "broken") {
            Ok(hand) => prop_assert_eq!(hand.check(), Ok(())),
            Err(error) => {
                let line = text.lines().nth(error.line - 1).unwrap_or_default();
                prop_assert!(error.column <= line.chars().count() + 2, "{}", error);
            }
        }
    }
}

/// Hands near the Utah/MIT hand that are still hands.
fn hands() -> impl Strategy<Value = Utah> {
    let rotation = prop_oneof![
        Just(Rotation::None),
        prop::array::uniform3(-10.0..10.0).prop_map(Rotation::Rpy),
        (-10.0..10.0).prop_map(|angle| Rotation::Axis {
            axis: [0.6, 0.0, -0.8],
            angle
        }),
    ];
    let numbers = vec(1e-6..1.0_f64, 8);
    let cutoff = proptest::option::of(1e-3..199.0_f64);
    let bias = proptest::option::of(4.0..130.0);
    (
        bias,
        rotation,
        numbers,
        cutoff,
        "[a-z \"\\\\=#é]{1,7}",
        0..5_usize,
    )
        .prop_map(
            |(bias, rotation, numbers, cutoff, name, kept): (_, _, Vec<f64>, _, String, _)| {
                let mut hand = UTAH.clone();
                hand.gravity[1] = -numbers[0] * 1e12;
                hand.contact = None;
                if kept == 0 {
                    hand.table = None;
                }
                hand.name = format!("x{name}").as_str().try_into().unwrap();
                hand.fingers.truncate(kept.max(1));
                for finger in &mut hand.fingers {
                    finger.base.rotation = rotation;
                    if let Form::Planar { lengths } = &mut finger.form {
                        lengths[3] *= numbers[1];
                    }
                    for joint in &mut finger.joints {
                        joint.servo.position_cutoff_hz = cutoff;
                        if cutoff.is_some() {
                            // Of most of these filters a stop would make the joint swing.
                            joint.stop.bandwidth_hz = 0.0;
                        }
                        joint.servo.kp = numbers[2];
                        joint.friction.viscous = numbers[3] * 1e-300;
                    }
                    for (number, actuator) in finger.actuators.iter_mut().enumerate() {
                        let is_flexor = number % 2 == 0;
                        let own = &finger.joints[number / 2].name;
                        if kept == 0 {
                            actuator.arms.clear();
                        }
                        let arm = |number: f64| 0.005 + 0.01 * number;
                        let arm = if is_flexor {
                            arm(numbers[4])
                        } else {
                            -arm(numbers[5])
                        };
                        actuator.arms.insert(own.clone(), arm).unwrap();
                        if !is_flexor {
                            actuator.limits.bias = bias;
                            actuator.cutoff_hz = cutoff;
                        }
                        if kept < 2 {
                            // Motors that no sensor watches.
                            (actuator.adc, actuator.faults) = (None, EffortFaults::default());
                            (actuator.gains, actuator.cutoff_hz) = (EffortGains::default(), None);
                        }
                    }
                    finger.joints[2].body = None;
                }
                hand
            },
        )
}
