// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [layout]: mod@layout
//! [watch]: Watch
//! [selections]: Selections
//! [client]: VariableClient
//! [watcher]: Watcher
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]
#![forbid(unsafe_code)]

// This module is a document.
pub mod layout;

// Scenarios out of bytes, for tests and fuzz targets.
#[cfg(all(feature = "hostile", not(condor_loom)))]
#[doc(hidden)]
pub mod hostile;

mod catalog;
mod cell;
mod client;
mod ends;
mod kind;
#[cfg(feature = "std")]
mod merge;
mod param;
mod sampler;
mod scalar;
mod selections;
mod server;
mod sync;
mod table;
mod var;
mod watcher;

// The variables and parameters that a program declares.
pub use kind::{AnyValue, ValueKind};
pub use param::{Param, ParamRefusal, Params, Tune};
pub use scalar::{Scalar, Storage};
pub use var::{Var, VarDescription, Vars, Watch};

// The types of the program that owns a table.
pub use catalog::{Catalog, CatalogError};
pub use cell::{CellField, CellStruct, CellValue, describe};
pub use ends::{Ends, VariableSettings};
pub use sampler::Sampler;
pub use selections::{MOST_WATCHERS, Selections};
pub use server::{Respond, VariableServer, answer};

// The types of a program that watches variables and sets parameters.
pub use cell::{Cell, CellError};
pub use client::{RequestError, VariableClient};
pub use layout::VARS;
#[cfg(feature = "std")]
pub use merge::{Merge, MergedRow};
pub use table::{TableEntry, VariableTable, VariableTableError};
pub use watcher::{RowHead, WatchError, Watcher};
