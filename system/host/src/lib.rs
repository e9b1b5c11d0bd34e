#![doc = include_str!("../README.md")]

// The modules from low to high; each uses only those before it:
//
// * `error`, `names`, `plain`, `signals`, `table`: what people type and are told, and the signals that end a program;
// * `system`, `control`, `view`, `watching`: a running system, its directory, protocol, memory and
//   variables;
// * `robot`, `messages`: a robot as people look at it and as it is computed, and rows as messages;
// * `recording`: what was recorded of a system;
// * `launch`, `extension`: how a processor is run, and what others add;
// * `description`, `gateway`, `application`, `reading`: what a system has, and the text that says so;
// * `services`, `supervisor`: what runs in a system;
// * `streams`: what other programs hand on of a system;
// * `listening`, `live`: what viewers on a network get of it, or of a robot alone;
// * `guard`, `screen`: this terminal, taken over by a picture;
// * `plot`: variables over time and the robot, drawn;
// * `counts`, `ui`, `commands`, `cli`: what people use.

pub mod answers;
mod application;
pub mod cli;
mod commands;
pub mod control;
mod counts;
pub mod description;
mod error;
mod events;
pub mod extension;
mod gateway;
mod guard;
mod launch;
mod listening;
mod live;
mod messages;
mod names;
mod peek;
mod plain;
mod plot;
mod reading;
pub mod recording;
pub mod robot;
mod screen;
pub mod services;
mod signals;
pub mod streams;
pub mod supervisor;
pub mod system;
mod table;
pub mod ui;
pub mod view;
pub mod watching;
