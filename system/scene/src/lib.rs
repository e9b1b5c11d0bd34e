#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

// The modules from low to high: `finger` knows where the links of a finger are, `tendon` the ways of its
// tendons, `urdf` how it is written, `capsule` how thick its links are, and `hand` puts fingers together;
// `plan` and `simulator` move it.

mod capsule;
mod finger;
mod hand;
mod plan;
mod simulator;
mod tendon;
mod urdf;

pub use hand::{Ball, HandView};
