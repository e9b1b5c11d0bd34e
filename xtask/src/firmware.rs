//! The packages that are built for targets of their own: the firmware tests, the images of harts beside a host, and
//! the firmwares of the benchmarks.

use std::path::PathBuf;

use crate::Result;
use crate::context::Context;

/// Their workspace, relative to the root.
pub(crate) const WORKSPACE: &str = "tests/firmware";

/// The firmwares whose instructions are counted.
pub(crate) const COUNTED: [&str; 3] = ["calibration", "condor-loops", "rtic-loops"];

/// The target of those firmwares.
pub(crate) const COUNTED_TARGET: &str = CORTEX_M3;

/// The target of the images that harts run beside a host.
pub(crate) const HARTS_TARGET: &str = "riscv64gc-unknown-none-elf";

/// The images that harts run beside a host.
pub(crate) const HART_IMAGES: [&str; 4] =
    ["monitor", "drills-hart", "experiment-hart", "rack-hart"];

/// A machine of QEMU, and the programs of the firmware tests that run there.
pub(crate) struct Machine {
    pub target: &'static str,
    /// The names of the programs, each of which tests a crate.
    pub programs: &'static [&'static str],
    /// The emulator.
    pub qemu: &'static str,
    /// The options for the machine, and for the way in which the programs print and end there.
    pub options: &'static str,
}

pub(crate) const MACHINES: [Machine; 4] = [
    Machine {
        target: HARTS_TARGET,
        programs: &["dev", "files", "hand", "mbox", "mos"],
        qemu: "qemu-system-riscv64",
        // The received bytes have any value, none of which is a command to QEMU.
        options: "-machine virt -smp 2 -bios none -display none -monitor none -serial stdio",
    },
    Machine {
        target: "thumbv6m-none-eabi",
        programs: &["dev", "files", "mbox", "mos"],
        qemu: "qemu-system-arm",
        // The board has the chip with 16 KiB of RAM, the firmwares want the one with 32.
        options: "-machine microbit -global nrf51-soc.sram-size=32768 -nographic -semihosting",
    },
    Machine {
        target: CORTEX_M3,
        programs: &["mos"],
        qemu: "qemu-system-arm",
        options: "-machine mps2-an385 -nographic -semihosting",
    },
    Machine {
        target: "thumbv7em-none-eabihf",
        programs: &["hand"],
        qemu: "qemu-system-arm",
        options: "-machine mps2-an386 -nographic -semihosting",
    },
];

const CORTEX_M3: &str = "thumbv7m-none-eabi";

impl Machine {
    /// Returns the options by which cargo selects some of the programs.
    pub(crate) fn selection(programs: &[&str]) -> String {
        format!("-p firmware --bin {}", programs.join(" --bin "))
    }
}

/// Returns the options by which cargo selects packages.
pub(crate) fn packages(names: &[&str]) -> String {
    format!("-p {}", names.join(" -p "))
}

/// Builds what cargo's options select in one call and one profile, and returns the directory of the images. The
/// target must be there.
///
/// # Errors
/// Returns an error if one of them cannot be built.
pub(crate) fn build(
    context: &Context,
    selection: &str,
    target: &str,
    profile: &str,
) -> Result<PathBuf> {
    let line = format!("cargo build --profile {profile} --locked {selection} --target {target}");
    // The descriptions of systems look for images there.
    context
        .command(&line)
        .dir(WORKSPACE)
        .env("CARGO_TARGET_DIR", "target")
        .run()?;
    let images = format!("{WORKSPACE}/target/{target}/{profile}");
    Ok(context.root.join(images))
}
