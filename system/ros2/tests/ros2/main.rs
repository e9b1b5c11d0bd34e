//! What the crate promises.

mod messages;
mod rows;
