//! What needs processes of its own: children, signals, and another compiler's programs.
//!
//! Between `fork` and `exec` a child holds the descriptors, and so the locks, of its parent: what claims numbers
//! beside it must wait for that.
#![cfg(not(condor_loom))]

mod doorbell;
mod examples;
mod fault;
mod linux_child;
mod other_end;
mod place;
mod system;
