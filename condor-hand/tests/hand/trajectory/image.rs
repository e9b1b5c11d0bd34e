//! Motions as bytes.

use condor_hand::trajectory::image::{HEADER_BYTES, MotionSequence, append, encode};
use condor_hand::trajectory::{
    Begin, Guards, MotionError, OnEnd, Pace, Primitive, Profile, Target, Via,
};
use condor_hand::{ImageError, Subject};
use crc::{CRC_32_ISO_HDLC, Crc};
use proptest::prelude::*;

const J: usize = 6;
type Motion = Primitive<J>;

fn guards() -> impl Strategy<Value = Guards> {
    let limit = || prop::option::of(-3.0..3.0);
    (limit(), limit(), limit(), any::<bool>()).prop_map(|(torque, effort, time, contact)| Guards {
        torque,
        effort,
        time,
        contact,
    })
}

/// Any that a generator takes; of joints outside of its mask it says nothing.
fn motion() -> impl Strategy<Value = Motion> {
    let pace = prop_oneof![
        (1e-3..9.0).prop_map(Pace::Duration),
        (1e-3..=1.0).prop_map(Pace::Speed)
    ];
    let profile = prop_oneof![
        Just(Profile::Cubic),
        Just(Profile::MinimumJerk),
        Just(Profile::Trapezoid),
        Just(Profile::JerkLimited)
    ];
    let begin = prop_oneof![Just(Begin::After), Just(Begin::Beside), Just(Begin::Now)];
    let on_end = prop_oneof![Just(OnEnd::Next), Just(OnEnd::Hold)];
    let target = prop_oneof![
        any::<f64>()
            .prop_filter("finite", |x| x.is_finite())
            .prop_map(Target::Absolute),
        (-1.0..1.0).prop_map(Target::Relative),
    ];
    let targets = prop::collection::vec(target, J);
    let vias = prop::collection::vec(prop::collection::vec(-2.0..2.0, J), 0..16);
    let shape = (pace, profile, begin, on_end, 0.0..0.5, guards(), guards());
    (1_u32..1 << J, targets, vias, shape).prop_map(
        |(mask, targets, vias, (pace, profile, begin, on_end, blend, start, stop))| {
            let mut motion = Motion::new(pace, profile);
            for (joint, target) in targets.into_iter().enumerate() {
                if mask >> joint & 1 == 1 {
                    motion = motion.with(joint, target).unwrap();
                }
            }
            if profile == Profile::Cubic {
                let count = f64::from(vias.len() as u32);
                for (number, via) in (1_u32..).zip(&vias) {
                    let place = |joint: usize| {
                        if mask >> joint & 1 == 1 {
                            via[joint]
                        } else {
                            0.0
                        }
                    };
                    let via = Via {
                        at: f64::from(number) / (count + 1.0),
                        positions: std::array::from_fn(place),
                    };
                    motion.vias.push(via).unwrap();
                }
            }
            (motion.begin, motion.on_end, motion.blend) = (begin, on_end, blend);
            (motion.start, motion.stop) = (start, stop);
            motion
        },
    )
}

fn image(motions: &[Motion]) -> Vec<u8> {
    let mut bytes = vec![0xa5; 65_536];
    let len = encode(J, motions, &mut bytes).unwrap();
    bytes.truncate(len);
    bytes
}

/// The bytes with a header that fits them.
fn sealed(count: u32, body: &[u8]) -> Vec<u8> {
    let mut bytes = b"CNDM".to_vec();
    bytes.extend(2_u16.to_le_bytes());
    bytes.extend((J as u16).to_le_bytes());
    bytes.extend(count.to_le_bytes());
    bytes.extend((body.len() as u32).to_le_bytes());
    let mut summed = bytes.clone();
    summed.extend(body);
    bytes.extend(
        Crc::<u32>::new(&CRC_32_ISO_HDLC)
            .checksum(&summed)
            .to_le_bytes(),
    );
    bytes.extend(body);
    bytes
}

proptest! {
    #[test]
    fn motions_come_back_from_their_bytes(motions in prop::collection::vec(motion(), 0..6)) {
        let bytes = image(&motions);
        let read = MotionSequence::<J>::new(J, &bytes).unwrap();
        prop_assert_eq!(read.len() as usize, motions.len());
        prop_assert_eq!(read.iter().collect::<Vec<_>>(), motions.clone());
        // One after another they are the same bytes.
        let mut buffer = vec![0; bytes.len()];
        let mut len = 0;
        for motion in &motions {
            len = append(J, motion, &mut buffer, len).unwrap();
        }
        if !motions.is_empty() {
            prop_assert_eq!(&buffer[..len], &bytes[..]);
        }
        // Whatever is missing or turned is noticed.
        for cut in 0..bytes.len() {
            prop_assert!(MotionSequence::<J>::new(J, &bytes[..cut]).is_err());
            let mut short = vec![0; cut];
            let refused = encode(J, &motions, &mut short);
            prop_assert_eq!(refused, Err(ImageError::BufferTooShort { len: cut }));
        }
    }

    #[test]
    fn a_bit_that_is_turned_is_noticed(
        motions in prop::collection::vec(motion(), 1..3), at in any::<prop::sample::Index>(), bit in 0_u8..8
    ) {
        let mut bytes = image(&motions);
        let at = at.index(bytes.len());
        bytes[at] ^= 1 << bit;
        prop_assert!(MotionSequence::<J>::new(J, &bytes).is_err());
    }

    #[test]
    fn no_bytes_make_it_panic(
        count in 0_u32..5, mut body in prop::collection::vec(any::<u8>(), 0..400), mask in 0_u32..64, plain in any::<bool>()
    ) {
        if plain && body.len() > 16 {
            // So that some get as far as the numbers.
            let mut head = [0; 24];
            head[..3].copy_from_slice(&[mask as u8, 0, 0]);
            let len = head.len().min(body.len());
            body[..len].copy_from_slice(&head[..len]);
        }
        let bytes = sealed(count, &body);
        if let Ok(read) = MotionSequence::<J>::new(J, &bytes) {
            prop_assert_eq!(read.iter().count(), count as usize);
            let motions: Vec<_> = read.iter().collect();
            let again = image(&motions);
            let again = MotionSequence::<J>::new(J, &again).unwrap();
            prop_assert_eq!(again.iter().collect::<Vec<_>>(), motions);
        }
        let _ = MotionSequence::<J>::new(J, &body);
        let mut buffer = body.clone();
        let _ = append(J, &one(), &mut buffer, body.len());
    }
}

fn one() -> Motion {
    Motion::new(Pace::Duration(0.5), Profile::MinimumJerk)
        .with(2, Target::Absolute(0.25))
        .unwrap()
}

#[test]
fn what_is_wrong_is_said() {
    let bytes = image(&[one()]);
    let len = bytes.len();
    let error = |bytes: &[u8]| MotionSequence::<J>::new(J, bytes).unwrap_err().to_string();
    assert_eq!(
        error(b"CNDHxxxxxxxxxxxxxxxx"),
        "the image begins with \"CNDH\" instead of \"CNDM\": it is another kind of file"
    );
    assert_eq!(
        error(&bytes[..len - 1]),
        format!(
            "the image must have {len} bytes, but there are {}; copy it again, as a whole",
            len - 1
        )
    );
    let mut other = bytes.clone();
    other[4] = 9;
    assert_eq!(
        error(&other),
        "the image has version 9 of the format, this program has 2; make the image again"
    );
    assert_eq!(
        MotionSequence::<7>::new(7, &bytes).unwrap_err(),
        ImageError::Count {
            of: "joints",
            found: 6,
            wanted: 7
        }
    );
    // The duration is the eight bytes after the mask and the kind of pace, a byte each.
    let mut body = bytes[HEADER_BYTES..].to_vec();
    body[2..10].copy_from_slice(&(-0.5_f64).to_le_bytes());
    let error = MotionSequence::<J>::new(J, &sealed(1, &body)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "motion 0: the duration, s, is -0.5; it must be above 0"
    );
    // The first mistake counts.
    assert_eq!(
        MotionSequence::<J>::new(J, &sealed(2, &body)).unwrap_err(),
        error
    );
    body[2..10].copy_from_slice(&0.5_f64.to_le_bytes());
    assert_eq!(
        MotionSequence::<J>::new(J, &sealed(2, &body)).unwrap_err(),
        ImageError::Malformed {
            at: Subject::Motion(1)
        }
    );
    let mut nothing = one();
    nothing.mask = 0;
    let refused = append(J, &nothing, &mut bytes.clone(), bytes.len()).unwrap_err();
    assert!(
        matches!(
            refused,
            ImageError::Content {
                at: Subject::Motion(1),
                ..
            }
        ),
        "{refused}"
    );
}

#[test]
fn a_tool_writes_for_a_number_of_joints_that_it_learns_later() {
    let last = |joint| {
        Motion::new(Pace::Duration(1.0), Profile::Cubic)
            .with(joint, Target::Absolute(0.5))
            .unwrap()
    };
    let (mut bytes, mut own) = ([0; 256], [0; 256]);
    let len = encode(4, &[last(3)], &mut bytes).unwrap();
    let same = Primitive::<4>::new(Pace::Duration(1.0), Profile::Cubic);
    let same = same.with(3, Target::Absolute(0.5)).unwrap();
    assert_eq!(encode(4, &[same], &mut own), Ok(len));
    assert_eq!(bytes[..len], own[..len]);
    let error = encode(4, &[last(3), last(4)], &mut bytes).unwrap_err();
    let at = Subject::Motion(1);
    let (mask, joints) = (0b1_0000, 4);
    let beyond = MotionError::Mask { mask, joints };
    assert_eq!(error, ImageError::Content { at, error: beyond });
    let error = encode(J + 1, &[last(3)], &mut bytes).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the image (the binary file) is for 7 joints, but this program for 6; build both for the same number"
    );
    // And a program that learns it later reads and appends.
    let len = append(4, &last(2), &mut bytes, len).unwrap();
    let motions = MotionSequence::<J>::new(4, &bytes[..len]).unwrap();
    assert!(motions.iter().eq([last(3), last(2)]));
    let others = MotionSequence::<J>::new(5, &bytes[..len]).unwrap_err();
    let (of, found, wanted) = ("joints", 4, 5);
    assert_eq!(others, ImageError::Count { of, found, wanted });
    let beyond = MotionSequence::<J>::new(J + 1, &bytes[..len]).unwrap_err();
    let (found, wanted) = (7, 6);
    assert_eq!(beyond, ImageError::Count { of, found, wanted });
    let refused = append(J + 1, &last(2), &mut bytes, len).unwrap_err();
    assert_eq!(refused, beyond);
    let error = append(4, &last(4), &mut bytes, len).unwrap_err();
    assert!(matches!(error, ImageError::Content { .. }), "{error}");
}
