//! What the system of the hand promises. One program: what all of these share is compiled once.

// What is shared: the system with a master that a test scripts, and the one with a person at its master's
// terminal, in one process and as processes.
mod ending;
mod rig;
mod typist;
mod up;

mod clients;
mod compile;
mod composed;
mod errors;
mod followed;
mod guards;
mod lost_readings;
mod memo;
mod modes;
mod motions;
mod on_harts;
mod ranges;
mod replay;
mod restarts;
mod simulated_time;
mod simulator;
mod stiffness;
mod stops;
mod streams;
mod virtual_time;
