//! The simulated hand against `MuJoCo`, and against what can be derived on paper.

#![cfg(feature = "sim")]

mod contacts;
mod drives;
mod energy;
mod mechanisms;
mod replay;
mod sensors;
#[path = "../support/mod.rs"]
mod support;
mod table;
