// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [layout]: mod@layout
//! [watch]: Watch
//! [desk]: Desk
//! [client]: Client
//! [watcher]: Watcher
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]
#![forbid(unsafe_code)]

// A document of its own.
pub mod layout;

mod catalog;
mod cell;
mod client;
mod desk;
mod ends;
mod kind;
#[cfg(feature = "std")]
mod merge;
mod param;
mod sampler;
mod scalar;
mod server;
mod sync;
mod table;
mod var;
mod watcher;

// What a program declares.
pub use kind::{Kind, Value};
pub use param::{Param, Params, Refusal, Tune};
pub use scalar::{Scalar, Storage};
pub use var::{Description, Var, Vars, Watch};

// The ends of its owner.
pub use catalog::{Catalog, CatalogError};
pub use cell::{Described, Field, describe};
pub use desk::Desk;
pub use ends::{Ends, Settings};
pub use sampler::Sampler;
pub use server::{Respond, Server, answer};

// The end of whoever watches and sets.
pub use cell::{Cell, CellError};
pub use client::{Client, RequestError};
pub use layout::VARS;
#[cfg(feature = "std")]
pub use merge::{Merge, Merged};
pub use table::{Entry, Table, TableError};
pub use watcher::{Row, WatchError, Watcher};
