//! The servo on a hart.
#![no_std]
#![no_main]

use condor_rt::Program as _;

board::program!(main);

fn main(hart: board::Hart) -> u32 {
    board::status(&two_processors::Servo.run(&hart))
}
