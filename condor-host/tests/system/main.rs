//! Whole systems: brought up, asked, killed in parts and as a whole, taken down.

mod commands;
mod finger;
mod programs;
mod running;
mod supervisor;
mod writer;
