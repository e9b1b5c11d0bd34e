//! Variables of the servos, sampled in the servo loop for whoever watches (feature `mbox`).
//!
//! A user selects a subset of the controller's variables while it runs, and a plotter shows them in
//! real time (memo, section 4.2). A [`Monitor`] in the servo loop writes rows into a ring in a window;
//! any number of [`MonitorReader`]s, in any process that maps the window, read them without stopping
//! anybody. A reader that is too slow knows exactly how many rows it lost, and never takes one for
//! whole that was overwritten while it was copied.
//!
#![cfg_attr(
    not(condor_loom),
    doc = "Which variables, and every which tick, is told by message: [`MonitorClient`] asks, [`MonitorHandler`]"
)]
#![cfg_attr(
    not(condor_loom),
    doc = "answers in the background, and the loop takes the selection over at the beginning of a tick."
)]
//! What the hand's controllers have to show is in [`FingerVariables`].
//!
//! # Layout
//!
//! Words of 32 bits, little-endian, from the beginning of the region, offsets in bytes:
//!
//! | offset | |
//! |---|---|
//! | 0 | "CMON", stored last |
//! | 4 | version of the layout, 1 |
//! | 8 | life: another number after each restart of the writer |
//! | 12 | variables |
//! | 16 | columns: the most variables of a row |
//! | 20 | rows of the ring, a power of two |
//! | 24 | servo ticks in a second |
//! | 64 | sequence of the newest row |
//! | 68 | number of the selection in force |
//! | 72 | every which tick makes a row |
//! | 76 | the selection, 8 words: bit *v* mod 32 of word *v* / 32 is variable *v* |
//! | 128 | for each variable 64 bytes: name (48) and unit (12) in UTF-8 with zeros after them, kind (4) |
//! | after them | the rows |
//!
//! Row *s* is at place *s* mod rows. It has its sequence when it is begun, its sequence when it is
//! complete, the number of the servo tick, the selection (8 words), and the values of the selected
//! variables, lowest first. Kind 0 is an IEEE 754 single in the unit of the variable, kind 1 an
//! unsigned number or bits. The first word of a row is written before, and the second after, all
//! others; each word is written in order (release) and read in order (acquire), so that a reader that
//! copied any word of a later row finds another first word afterwards.

#[cfg(not(condor_loom))]
mod client;
mod finger;
#[cfg(not(condor_loom))]
mod handler;
mod layout;
#[cfg(not(condor_loom))]
mod object;
mod reader;
mod ring;
mod selection;
mod variable;

#[cfg(not(condor_loom))]
pub use client::{MonitorClient, MonitorClientError};
pub use finger::{FingerVariables, JointVariable, Quantity, TendonVariable};
#[cfg(not(condor_loom))]
pub use handler::{MONITOR, MonitorHandler, MonitorPlaces};
pub use layout::{COLUMNS, VARIABLES, ring_bytes};
#[cfg(not(condor_loom))]
pub use object::{Monitor, MonitorObject};
pub use reader::{MonitorReader, MonitorReaderError, Row};
pub use ring::{MonitorError, Ring};
pub use selection::{Selection, SelectionError};
pub use variable::{Kind, Variable};
