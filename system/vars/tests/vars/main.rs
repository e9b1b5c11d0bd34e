//! The promises of README.md.

mod catalogs;
mod cells;
mod hostile;
mod merging;
mod model;
mod requests;
mod support;
