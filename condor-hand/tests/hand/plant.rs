//! The simulated hand against `MuJoCo`, and against what can be derived on paper.

#![cfg(feature = "sim")]
#![allow(
    clippy::float_cmp,
    reason = "some results are exact, or are set and not computed"
)]

mod configured;
mod contacts;
mod drives;
mod energy;
mod grasp;
pub(crate) mod mechanisms;
mod noise;
mod replay;
mod table;
