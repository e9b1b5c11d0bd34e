//! Turns the text of the shipped hand into the image that a processor has linked in.

use std::error::Error;
use std::path::PathBuf;

use condor_hand::config::Hand;

const TEXT: &str = "../../../condor-hand/hands/utah-mit.toml";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed={TEXT}");
    let mut hand = Hand::<4, 4>::from_toml(&std::fs::read_to_string(TEXT)?, TEXT)?;
    // The exercise has sensors that wander whatever is asked of them, and that fail for longer.
    hand.faults.frozen_rad = 10.0;
    hand.faults.lost_samples = 40;
    let mut image = [0; 16384];
    let len = hand.to_image(&mut image)?;
    let image = image.get(..len).ok_or("an image longer than its buffer")?;
    std::fs::write(
        PathBuf::from(std::env::var("OUT_DIR")?).join("utah-mit.image"),
        image,
    )?;
    Ok(())
}
