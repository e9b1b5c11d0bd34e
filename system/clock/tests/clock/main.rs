//! What programs see of a simulated time.
#![cfg(all(target_os = "linux", feature = "linux", not(condor_loom)))]

mod page;
mod reference;
mod system;
mod systems;
