#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

// The modules from low to high: `finger` knows where the links of a finger are, `tendon` the ways of its
// tendons, `urdf` how it is written, and `hand` puts fingers together.

mod finger;
mod hand;
mod tendon;
mod urdf;

pub use hand::{Ball, HandView};
