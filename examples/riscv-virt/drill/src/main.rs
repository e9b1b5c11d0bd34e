//! Drills for harts: what the first argument says, to the end, or to the bitter end.
#![no_std]
#![no_main]

mod depths;
mod faulty;
mod instructions;

use board::{Hart, stack, status};
use condor_rt::Program as _;
use drills::{Echo, Stress, Table};

board::program!(main);

/// The status of a program that there is not.
const NO_PROGRAM: u32 = 2;

fn main(mut hart: Hart) -> u32 {
    match hart.program() {
        Some("echo") => status(&Echo.run(&hart)),
        Some("stress") => status(&Stress(|| stack::deepest(&hart)).run(&hart)),
        Some("table") => status(&Table.run(&hart)),
        Some("instructions") => status(&instructions::run(&hart)),
        Some("stack") => status(&depths::run(&hart)),
        Some("faulty") => status(&faulty::Faulty.run(&hart)),
        _ => NO_PROGRAM,
    }
}
