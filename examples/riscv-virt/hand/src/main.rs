//! The processors of the Utah/MIT hand: the programs as they are, and which of them runs, the first
//! argument says.
#![no_std]
#![no_main]

use board::{Hart, status};
use condor_rt::Program as _;
use utah_mit_hand::master::Master;
use utah_mit_hand::replay::Replay;
use utah_mit_hand::servo::Servo;
use utah_mit_hand::table::Table;

board::program!(main);

/// The status of a program that there is not.
const NO_PROGRAM: u32 = 2;

fn main(mut hart: Hart) -> u32 {
    match hart.program() {
        Some("master") => status(&Master.run(&hart)),
        Some("replay") => status(&Replay.run(&hart)),
        Some("servo") => status(&Servo.run(&hart)),
        Some("table") => status(&Table.run(&hart)),
        _ => NO_PROGRAM,
    }
}
