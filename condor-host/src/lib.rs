#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]

pub mod harts;

// The program `condor`.
#[cfg(feature = "program")]
pub mod cli;
#[cfg(feature = "program")]
mod commands;
#[cfg(feature = "program")]
pub mod control;
#[cfg(feature = "program")]
pub mod description;
#[cfg(feature = "program")]
mod plain;
#[cfg(feature = "program")]
pub mod services;
#[cfg(feature = "program")]
pub mod supervisor;
#[cfg(feature = "program")]
pub mod system;
#[cfg(feature = "program")]
pub mod ui;
#[cfg(feature = "program")]
pub mod view;
