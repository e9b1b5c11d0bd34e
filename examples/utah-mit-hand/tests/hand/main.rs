//! What the system of the hand promises. One program: what all of these share is compiled once.

// What is shared: the system with a master that a test scripts, and the one with a person at its master's
// terminal, in one process and as processes.
#[cfg(feature = "sim")]
mod rig;
#[cfg(feature = "sim")]
mod typist;
#[cfg(feature = "program")]
mod up;

#[cfg(feature = "sim")]
mod clients;
#[cfg(feature = "std")]
mod compile;
#[cfg(feature = "program")]
mod composed;
#[cfg(feature = "sim")]
mod followed;
#[cfg(feature = "sim")]
mod guards;
#[cfg(feature = "std")]
mod lost_readings;
#[cfg(feature = "sim")]
mod memo;
#[cfg(feature = "sim")]
mod modes;
#[cfg(feature = "sim")]
mod motions;
#[cfg(feature = "sim")]
mod ranges;
#[cfg(feature = "sim")]
mod replay;
#[cfg(feature = "program")]
mod restarts;
#[cfg(feature = "program")]
mod simulated_time;
#[cfg(all(feature = "sim", feature = "program"))]
mod simulator;
#[cfg(feature = "sim")]
mod stiffness;
#[cfg(feature = "sim")]
mod stops;
#[cfg(feature = "program")]
mod streams;
#[cfg(feature = "sim")]
mod virtual_time;
