//! The Utah/MIT hand: `condor` with the programs of its processors.
//!
//! Without arguments it brings up the system of `system.toml`.

use std::process::ExitCode;

use condor_robot::program::RobotApplication;
use qemu_virt_host::HARTS;

fn main() -> ExitCode {
    RobotApplication::new(concat!(env!("CARGO_MANIFEST_DIR"), "/system.toml"))
        .with_extensions(&[HARTS])
        .run()
}
