#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod cdr;
mod layout;
mod messages;
mod names;
mod schema;

pub use cdr::{DecodeError, Writer};
pub use layout::{Field, Head, Layout, LayoutError, Row};
pub use messages::{JointState, Level, Log, TFMessage, Text, Time, Transform};
pub use names::{field_name, type_name};
pub use schema::{ENCODING, Message, SCHEMA_ENCODING, encode, schema};
