//! Drills for harts: what the first argument says, to the end, or to the bitter end.
#![no_std]
#![no_main]

mod arrivals;
mod debugged;
mod faulty;
mod instructions;

use board::{Hart, stack, status};
use drills::{Echo, Order, Stress, Table};

board::program!(main);

/// The status of a program that there is not.
const NO_PROGRAM: u32 = 2;

fn main(mut hart: Hart) -> u32 {
    match hart.program() {
        Some("arrivals") => board::run(&arrivals::Arrivals, &hart),
        Some("arrivals-target") => board::run(&arrivals::Target, &hart),
        Some(program @ ("debugged" | "debugged-alone")) => {
            let nests = program == "debugged";
            board::run(&debugged::Debugged { nests }, &hart)
        }
        Some("echo") => board::run(&Echo, &hart),
        Some("order") => board::run(&Order, &hart),
        Some("stress") => board::run(&Stress(|| stack::deepest(&hart)), &hart),
        Some("table") => board::run(&Table, &hart),
        Some("instructions") => status(&instructions::run(&hart), &hart),
        Some("faulty") => board::run(&faulty::Faulty, &hart),
        _ => NO_PROGRAM,
    }
}
