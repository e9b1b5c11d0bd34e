//! What commands answer with `--json`, for programs that hand it on.

pub use crate::commands::ps::answer as ps;
pub use crate::commands::vars::{answer as vars, values};
