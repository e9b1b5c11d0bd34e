//! Tests of the messages between processors. They are one program, so that what they share is compiled once.

mod grasps;
mod motions;
mod queue;
mod servos;
