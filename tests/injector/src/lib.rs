#![doc = include_str!("../README.md")]

mod atomics;
mod command_line;
mod plan;
mod points;

pub use atomics::{AtomicBool, AtomicU8, AtomicU32};
pub use command_line::{argument, seed};
pub use plan::{Interrupts, Plan, explore};
pub use points::{Access, Section, point, quietly, with_points};
