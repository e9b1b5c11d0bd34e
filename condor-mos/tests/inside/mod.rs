//! What cannot be seen from outside.

mod grids;
mod records;
