//! Hostile peers, driven by bytes: a host that answers a client with anything, and a client that asks
//! a server for anything.
//!
//! Property tests and fuzz targets include this module, hence no names of either.

pub(crate) mod client;
pub(crate) mod host;
mod source;

use source::Source;
