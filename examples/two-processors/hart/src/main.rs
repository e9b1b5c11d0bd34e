//! The servo on a hart.
#![no_std]
#![no_main]

use board::{Hart, status};
use condor_rt::Program as _;
use two_processors::Servo;

board::program!(main);

fn main(hart: Hart) -> u32 {
    status(&Servo.run(&hart))
}
