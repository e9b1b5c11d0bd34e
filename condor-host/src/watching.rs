//! The variables of a running system: their names, and their values while programs run.
//!
//! [`Known`] finds names; [`Rows`] reads what loops write for this visitor, and what is published;
//! [`Clients`] gets and sets parameters.

mod clients;
mod known;
mod rows;
mod types;

pub(crate) use clients::{ANSWER, Clients};
pub(crate) use known::{Known, One};
pub(crate) use rows::{Row, Rows, Source};
pub(crate) use types::Type;
