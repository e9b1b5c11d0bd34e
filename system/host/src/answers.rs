//! What commands answer with `--json`, for programs that hand it on.

mod processors;
mod variables;

pub use processors::{ProcessorReport, ProcessorRow, processors};
pub use variables::{Variable, all_values, values, variable, variables};
