#![doc = include_str!("../README.md")]

// The modules from low to high; each uses only those before it:
//
// * `error`, `names`, `paths`, `plain`, `signals`: what people type and are told, and the signals that end a program;
// * `system`, `control`, `view`, `watching`: a running system, its directory, protocol, memory and
//   variables;
// * `robot`, `messages`: a robot as people look at it and as it is computed, and rows as messages;
// * `launch`, `extension`: how a processor is run, and what others add;
// * `description`, `gateway`, `application`, `reading`: what a system has, and the text that says so;
// * `services`, `supervisor`: what runs in a system;
// * `answers`, `events`, `streams`: what other programs hand on of a system.

pub mod answers;
pub mod application;
pub mod control;
pub mod description;
pub mod error;
pub mod events;
pub mod extension;
pub mod gateway;
mod launch;
pub mod messages;
pub mod names;
pub mod paths;
pub mod plain;
pub mod reading;
pub mod robot;
pub mod services;
pub mod signals;
pub mod streams;
pub mod supervisor;
pub mod system;
pub mod view;
pub mod watching;
