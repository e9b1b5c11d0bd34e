//! What is built for targets of its own: the firmware tests, the images of harts beside a host, and
//! the firmwares of the benchmarks.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::Result;
use crate::context::Context;

/// Their workspace, relative to the root.
pub(crate) const WORKSPACE: &str = "firmware-tests";

/// The workspace of the firmwares whose instructions are counted, relative to the root.
pub(crate) const BENCH: &str = "bench/firmware";

/// What those are built for.
pub(crate) const BENCH_TARGET: &str = "thumbv7m-none-eabi";

/// The workspace of the images that harts run beside a host, relative to the root.
pub(crate) const HARTS: &str = "boards/qemu-virt";

/// What those are built for.
pub(crate) const HARTS_TARGET: &str = "riscv64gc-unknown-none-elf";

/// Those images.
pub(crate) const HART_IMAGES: [&str; 3] = ["monitor", "drills-hart", "utah-mit-hand-hart"];

/// One of the firmware tests.
pub(crate) struct Firmware {
    pub package: &'static str,
    /// The package of the checks that it makes.
    pub exercise: &'static str,
    pub target: &'static str,
    /// The program that runs it.
    pub qemu: &'static str,
    /// The Debian package of that program.
    pub debian: &'static str,
    /// The machine, and how the firmware talks and ends there.
    pub machine: &'static str,
}

pub(crate) const FIRMWARES: [Firmware; 11] = [
    Firmware {
        package: "mbox-riscv",
        exercise: "mbox-exercise",
        target: "riscv64gc-unknown-none-elf",
        qemu: "qemu-system-riscv64",
        debian: "qemu-system-misc",
        machine: "-machine virt -smp 2 -bios none -nographic",
    },
    Firmware {
        package: "mbox-cortex-m",
        exercise: "mbox-exercise",
        target: "thumbv6m-none-eabi",
        qemu: "qemu-system-arm",
        debian: "qemu-system-arm",
        // The board has the chip with 16 KiB of RAM, the firmware wants the one with 32.
        machine: "-machine microbit -global nrf51-soc.sram-size=32768 -nographic -semihosting",
    },
    Firmware {
        package: "dev-riscv",
        exercise: "dev-exercise",
        target: "riscv64gc-unknown-none-elf",
        qemu: "qemu-system-riscv64",
        debian: "qemu-system-misc",
        // What it receives are bytes of any value, none of which is a command to QEMU.
        machine: "-machine virt -bios none -display none -monitor none -serial stdio",
    },
    Firmware {
        package: "dev-cortex-m",
        exercise: "dev-exercise",
        target: "thumbv6m-none-eabi",
        qemu: "qemu-system-arm",
        debian: "qemu-system-arm",
        machine: "-machine microbit -global nrf51-soc.sram-size=32768 -nographic -semihosting",
    },
    Firmware {
        package: "files-firmware",
        exercise: "files-exercise",
        target: "riscv64gc-unknown-none-elf",
        qemu: "qemu-system-riscv64",
        debian: "qemu-system-misc",
        machine: "-machine virt -bios none -nographic",
    },
    Firmware {
        package: "files-firmware",
        exercise: "files-exercise",
        target: "thumbv6m-none-eabi",
        qemu: "qemu-system-arm",
        debian: "qemu-system-arm",
        machine: "-machine microbit -global nrf51-soc.sram-size=32768 -nographic -semihosting",
    },
    Firmware {
        package: "hand-firmware",
        exercise: "hand-exercise",
        target: "riscv64gc-unknown-none-elf",
        qemu: "qemu-system-riscv64",
        debian: "qemu-system-misc",
        machine: "-machine virt -bios none -nographic",
    },
    Firmware {
        package: "hand-firmware",
        exercise: "hand-exercise",
        target: "thumbv7em-none-eabihf",
        qemu: "qemu-system-arm",
        debian: "qemu-system-arm",
        machine: "-machine mps2-an386 -nographic -semihosting",
    },
    Firmware {
        package: "mos-riscv",
        exercise: "mos-exercise",
        target: "riscv64gc-unknown-none-elf",
        qemu: "qemu-system-riscv64",
        debian: "qemu-system-misc",
        machine: "-machine virt -bios none -nographic",
    },
    Firmware {
        package: "mos-cortex-m",
        exercise: "mos-exercise",
        target: "thumbv7m-none-eabi",
        qemu: "qemu-system-arm",
        debian: "qemu-system-arm",
        machine: "-machine mps2-an385 -nographic -semihosting",
    },
    Firmware {
        package: "mos-cortex-m",
        exercise: "mos-exercise",
        target: "thumbv6m-none-eabi",
        qemu: "qemu-system-arm",
        debian: "qemu-system-arm",
        machine: "-machine microbit -global nrf51-soc.sram-size=32768 -nographic -semihosting",
    },
];

/// The firmwares of each target, which are built in one call.
pub(crate) fn groups() -> Vec<Vec<&'static Firmware>> {
    let mut groups = BTreeMap::<_, Vec<_>>::new();
    for firmware in &FIRMWARES {
        groups.entry(firmware.target).or_default().push(firmware);
    }
    groups.into_values().collect()
}

/// Builds packages of a workspace in one call and one profile, and says in which directory the images
/// are. The target must be there.
///
/// # Errors
/// One cannot be built.
pub(crate) fn build(
    context: &Context,
    workspace: &str,
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
    // Where the descriptions of systems look for images.
    context
        .command(&line)
        .dir(workspace)
        .env("CARGO_TARGET_DIR", "target")
        .run()?;
    let images = format!("{workspace}/target/{target}/{profile}");
    Ok(context.root.join(images))
}
