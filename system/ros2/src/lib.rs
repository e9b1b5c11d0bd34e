#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod cdr;
mod layout;
mod messages;
mod names;
mod schema;

pub use cdr::{CdrWriter, DecodeError};
pub use layout::{Head, Layout, LayoutError, RosField, RowMessage};
pub use messages::{JointState, Level, Log, StringMessage, TFMessage, Time, Transform};
pub use names::{field_name, type_name};
pub use schema::{ENCODING, RosMessage, SCHEMA_ENCODING, encode, schema};
