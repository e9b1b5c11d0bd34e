use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::tools::need_target;

/// The targets, from the smallest (no compare-and-swap) to the one whose harts run under QEMU.
const TARGETS: [&str; 4] = [
    "thumbv6m-none-eabi",
    "thumbv7em-none-eabihf",
    "riscv32imac-unknown-none-elf",
    "riscv64gc-unknown-none-elf",
];

/// The libraries that run without an operating system, in sets that are built together. What asks for
/// features of the others is in the second: in the first, each is as small as it gets.
const SETS: [(&str, &str); 3] = [
    (
        "-p condor-clock -p condor-debug -p condor-dev -p condor-fs -p condor-hand -p condor-mbox -p condor-mcap -p \
         condor-mos -p condor-platform -p condor-robot -p condor-rt -p condor-tty -p condor-vars -p qemu-virt-host",
        "",
    ),
    (
        "-p condor-dev -p condor-fs -p condor-hand -p condor-mbox -p condor-mos -p condor-tty",
        "--features condor-dev/conformance,condor-dev/models,condor-dev/riscv,condor-hand/sim,\
         condor-mbox/async,condor-mbox/conformance,condor-mbox/riscv,condor-mos/conformance,\
         condor-mos/cortex-m,condor-mos/riscv",
    ),
    (
        "-p two-processors -p utah-mit-boards",
        "--features utah-mit-boards/robot",
    ),
];

/// Nothing is run; the manifest has these optimized for the tests.
const UNOPTIMIZED: &str = "--config profile.dev.package.condor-hand.opt-level=0 \
                           --config profile.dev.package.condor-mos.opt-level=0 \
                           --config profile.dev.package.condor-robot.opt-level=0 \
                           --config profile.dev.package.utah-mit-boards.opt-level=0";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let mut targets = String::new();
    for target in TARGETS {
        need_target(context, target)?;
        targets += " --target ";
        targets += target;
    }
    let mut builds = 0;
    for (libraries, features) in SETS {
        let line = format!(
            "cargo build {UNOPTIMIZED} {libraries} --lib --no-default-features {features} {targets}"
        );
        context.command(&line).run()?;
        builds += libraries.matches("-p ").count() * TARGETS.len();
    }
    Ok(Summary::of(format!(
        "{builds} builds for {} targets",
        TARGETS.len()
    )))
}
