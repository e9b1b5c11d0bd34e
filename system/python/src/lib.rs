#![doc = include_str!("../README.md")]

// The modules from low to high: `failure` makes exceptions of errors, `watch` keeps what is read of a system until
// Python wants it, `desk` is the thread that visits the system, `terminal` and `motions` are parts of it, `system` is
// all that is asked of it; `hand` needs no system, and `simulator` is a processor of one.

mod failure;
mod hand;
mod motions;
mod published;
mod simulator;
mod system;
mod system_worker;
mod terminal;
mod values;
mod watch;

use pyo3::prelude::*;

/// The native part that Python code wraps.
#[pymodule]
mod _condor {
    #[pymodule_export]
    use super::hand::Hand;
    #[pymodule_export]
    use super::simulator::Simulator;
    #[pymodule_export]
    use super::system::{System, running};
    #[pymodule_export]
    use super::terminal::Terminal;
    #[pymodule_export]
    use super::watch::Watch;
}
