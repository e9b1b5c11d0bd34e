//! The experiment on a hart.
#![no_std]
#![no_main]

board::program!(main);

fn main(hart: board::Hart) -> u32 {
    board::run(&experiment::Experiment, &hart)
}
