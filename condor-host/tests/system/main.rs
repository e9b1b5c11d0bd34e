//! Whole systems: brought up, asked, killed in parts and as a whole, taken down.

mod bounds;
mod commands;
mod extensions;
mod family;
mod joint;
mod programs;
mod running;
mod supervisor;
mod writer;
