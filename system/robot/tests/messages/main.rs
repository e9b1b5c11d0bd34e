//! What the messages between processors promise. One program: what all of these share is compiled once.

mod grasps;
mod motions;
mod queue;
mod servos;
