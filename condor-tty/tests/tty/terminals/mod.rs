//! What a hostile end of a terminal does to the other one, and a person to a line editor, out of bytes.
//!
//! Both the property tests and the fuzz targets include this module, hence no names of either.
#![allow(
    dead_code,
    reason = "not every program that includes it uses both ends"
)]

pub(crate) mod haunted;
pub(crate) mod processor;
pub(crate) mod reader;
pub(crate) mod script;
#[path = "../support/mod.rs"]
pub(crate) mod support;
pub(crate) mod typing;
