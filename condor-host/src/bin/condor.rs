//! Brings up a robot, and looks after it.

fn main() {}
