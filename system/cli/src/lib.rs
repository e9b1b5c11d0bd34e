#![doc = include_str!("../README.md")]

// The modules from low to high; each uses only those before it:
//
// * `table`: what people read in columns;
// * `recording`: what was recorded of a system;
// * `listening`, `live`: what viewers on a network get of a system, or of a robot alone;
// * `guard`, `screen`: this terminal, taken over by a picture;
// * `peek`, `plot`: variables over time and the robot, drawn;
// * `demo`, `counts`, `ui`, `commands`, `line`: what people use.

mod commands;
mod counts;
mod demo;
mod guard;
// Functions that fuzz targets call with arbitrary bytes.
#[cfg(feature = "hostile")]
#[doc(hidden)]
pub mod hostile;
mod line;
mod listening;
mod live;
mod peek;
mod plot;
pub mod recording;
mod screen;
mod table;
mod ui;

pub use condor_host::application::{Application, ProgramFunction, Programs};
pub use condor_host::error::AnyError;
pub use line::main;
