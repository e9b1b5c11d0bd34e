//! The answers of commands with `--json`, for programs that serve them by other means.

mod processors;
mod variables;

pub use processors::{ProcessorReport, ProcessorRow, processors};
pub use variables::{Variable, all_values, values, variable, variables};
