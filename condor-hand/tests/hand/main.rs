//! What the crate promises. One program: what all of these share is compiled once.

// What is shared.
mod support;

// The building blocks.
mod decimal;
mod friction;
mod linear;
mod math;

// The robot.
mod config_files;
mod config_hands;
mod config_mistakes;
mod dynamics;
mod dynamics_physics;
mod kinematics;
mod nearest;
mod reach;
mod transmission;
mod wiring;

// Its control.
mod control;
mod controller;
mod controller_guards;
mod effort_servo;
mod encoders;
mod faults;
mod followers;
mod grasp;
mod impedance;
mod servo_actuators;
mod servo_closed_loop;
mod soft_stop;
mod table;
mod trajectory;
mod tunable;

// Whatever comes, and what is simulated.
mod hostile_hand;
mod plant;
