//! A hand with a motor at each joint: `condor` with the programs of its processors.

use std::process::ExitCode;

use condor_robot::program::RobotApplication;
use qemu_virt_host::HARTS;
use utah_mit_boards::robot::PROCESSES;

fn main() -> ExitCode {
    let system = concat!(env!("CARGO_MANIFEST_DIR"), "/system.toml");
    RobotApplication::new(system, &PROCESSES)
        .with_extensions(&[HARTS])
        .run()
}
