// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [layout]: mod@layout
//! [watch]: Watch
//! [desk]: Selections
//! [client]: VariableClient
//! [watcher]: Watcher
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]
#![forbid(unsafe_code)]

// A document of its own.
pub mod layout;

// What tests and fuzz targets make of bytes.
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

// What a program declares.
pub use kind::{AnyValue, ValueKind};
pub use param::{Param, ParamRefusal, Params, Tune};
pub use scalar::{Scalar, Storage};
pub use var::{Var, VarDescription, Vars, Watch};

// The ends of its owner.
pub use catalog::{Catalog, CatalogError};
pub use cell::{CellField, CellStruct, describe};
pub use ends::{Ends, VariableSettings};
pub use sampler::Sampler;
pub use selections::{MOST_WATCHERS, Selections};
pub use server::{Respond, VariableServer, answer};

// The end of whoever watches and sets.
pub use cell::{Cell, CellError};
pub use client::{RequestError, VariableClient};
pub use layout::VARS;
#[cfg(feature = "std")]
pub use merge::{Merge, MergedRow};
pub use table::{TableEntry, VariableTable, VariableTableError};
pub use watcher::{RowHead, WatchError, Watcher};
