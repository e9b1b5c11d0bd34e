//! The processors of the Utah/MIT hand. The programs are those of `condor-robot`; the first
//! argument selects one of them.
#![no_std]
#![no_main]

use board::Hart;
use condor_robot::master::Master;
use condor_robot::replay::Replay;
use condor_robot::servo::Servo;
use condor_robot::table::Table;
use utah_mit_boards::robot::Rack;

board::program!(main);

/// The status of a program that there is not.
const NO_PROGRAM: u32 = 2;

fn main(mut hart: Hart) -> u32 {
    match hart.program() {
        Some("master") => board::run(&Master, &hart),
        Some("replay") => board::run(&Replay, &hart),
        Some("servo") => board::run(&Servo::<Rack>::new(), &hart),
        Some("table") => board::run(&Table::<Rack>::new(), &hart),
        _ => NO_PROGRAM,
    }
}
