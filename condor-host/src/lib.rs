#![doc = include_str!("../README.md")]

pub mod cli;
mod commands;
pub mod control;
pub mod description;
pub mod extension;
mod plain;
pub mod services;
pub mod supervisor;
pub mod system;
pub mod ui;
pub mod view;
