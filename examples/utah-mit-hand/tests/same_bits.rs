//! The same input gives condor-hand's controllers the same bits here as in the firmwares under
//! `tests/firmware`.
//!
//! A program of its own: beside code of a dependency that is not optimized, the tests of the system would
//! use its copies of generic functions, and take twice the time.

use std::path::Path;

use condor_hand::config::Hand;

const TEXT: &str = include_str!("../../../condor-hand/hands/utah-mit.toml");

/// The image of the shipped hand as the exercise needs it.
fn image() -> Vec<u8> {
    let mut hand = Hand::<4, 4, 8>::from_toml(TEXT, "utah-mit.toml").unwrap();
    // The exercise has sensors that wander whatever is asked of them, and that fail for longer.
    hand.faults.frozen_rad = 10.0;
    hand.faults.lost_samples = 40;
    let mut image = vec![0; 16384];
    let len = hand.to_image(&mut image).unwrap();
    image.truncate(len);
    image
}

#[test]
fn the_image_of_the_firmwares_is_that_of_the_text() {
    assert!(
        image() == hand_exercise::IMAGE,
        "`cargo test -p utah-mit-hand --test same_bits -- --ignored` makes the image anew"
    );
}

#[test]
#[ignore = "makes the image of the firmwares anew"]
fn image_anew() {
    let exercise = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/firmware/hand-exercise");
    std::fs::write(exercise.join("data/utah-mit.image"), image()).unwrap();
}

#[test]
fn every_level_gives_the_committed_bits() {
    let mut differ = 0;
    hand_exercise::same_bits(&mut |level, found, committed| {
        if found != Some(committed) {
            println!("{level}: {found:#x?}, not {committed:#x}");
            differ += 1;
        }
    });
    assert_eq!(differ, 0, "levels whose bits are others");
}
