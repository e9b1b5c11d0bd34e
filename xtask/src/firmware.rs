//! The packages that are built for targets of their own: the firmware tests, the images of harts beside a host, and
//! the firmwares of the benchmarks.

use std::collections::BTreeMap;
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
pub(crate) const HART_IMAGES: [&str; 3] = ["monitor", "drills-hart", "rack-hart"];

/// One of the firmware tests.
pub(crate) struct Firmware {
    pub package: &'static str,
    /// The package of the checks that it makes.
    pub exercise: &'static str,
    pub target: &'static str,
}

impl Firmware {
    /// Returns the emulator that runs it.
    pub(crate) fn qemu(&self) -> &'static str {
        match self.target {
            RISCV => "qemu-system-riscv64",
            _ => "qemu-system-arm",
        }
    }

    /// Returns the options for the machine, and for the way in which the firmware prints and ends there.
    pub(crate) fn machine(&self) -> &'static str {
        match self.target {
            // The received bytes have any value, none of which is a command to QEMU.
            RISCV => "-machine virt -smp 2 -bios none -display none -monitor none -serial stdio",
            // The board has the chip with 16 KiB of RAM, the firmwares want the one with 32.
            CORTEX_M0 => {
                "-machine microbit -global nrf51-soc.sram-size=32768 -nographic -semihosting"
            }
            CORTEX_M3 => "-machine mps2-an385 -nographic -semihosting",
            _ => "-machine mps2-an386 -nographic -semihosting",
        }
    }
}

const RISCV: &str = HARTS_TARGET;
const CORTEX_M0: &str = "thumbv6m-none-eabi";
const CORTEX_M3: &str = "thumbv7m-none-eabi";
const CORTEX_M4: &str = "thumbv7em-none-eabihf";

pub(crate) const FIRMWARES: [Firmware; 11] = [
    firmware("mbox-riscv", "mbox-exercise", RISCV),
    firmware("mbox-cortex-m", "mbox-exercise", CORTEX_M0),
    firmware("dev-riscv", "dev-exercise", RISCV),
    firmware("dev-cortex-m", "dev-exercise", CORTEX_M0),
    firmware("files-firmware", "files-exercise", RISCV),
    firmware("files-firmware", "files-exercise", CORTEX_M0),
    firmware("hand-firmware", "hand-exercise", RISCV),
    firmware("hand-firmware", "hand-exercise", CORTEX_M4),
    firmware("mos-riscv", "mos-exercise", RISCV),
    firmware("mos-cortex-m", "mos-exercise", CORTEX_M3),
    firmware("mos-cortex-m", "mos-exercise", CORTEX_M0),
];

const fn firmware(package: &'static str, exercise: &'static str, target: &'static str) -> Firmware {
    Firmware {
        package,
        exercise,
        target,
    }
}

/// Returns the firmwares of each target, which are built in one call.
pub(crate) fn groups() -> Vec<Vec<&'static Firmware>> {
    let mut groups = BTreeMap::<_, Vec<_>>::new();
    for firmware in &FIRMWARES {
        groups.entry(firmware.target).or_default().push(firmware);
    }
    groups.into_values().collect()
}

/// Builds packages in one call and one profile, and returns the directory of the images. The target must be
/// there.
///
/// # Errors
/// Returns an error if one of them cannot be built.
pub(crate) fn build(
    context: &Context,
    packages: &[&str],
    target: &str,
    profile: &str,
    features: &[String],
) -> Result<PathBuf> {
    let mut line = format!(
        "cargo build --profile {profile} --locked -p {} --target {target}",
        packages.join(" -p ")
    );
    if !features.is_empty() {
        line = format!("{line} --features {}", features.join(","));
    }
    // The descriptions of systems look for images there.
    context
        .command(&line)
        .dir(WORKSPACE)
        .env("CARGO_TARGET_DIR", "target")
        .run()?;
    let images = format!("{WORKSPACE}/target/{target}/{profile}");
    Ok(context.root.join(images))
}
