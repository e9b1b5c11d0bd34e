use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tools::need_target;

/// From the smallest (no compare-and-swap) to the one whose harts run under QEMU.
const TARGETS: [&str; 4] = [
    "thumbv6m-none-eabi",
    "thumbv7em-none-eabihf",
    "riscv32imac-unknown-none-elf",
    "riscv64gc-unknown-none-elf",
];

/// The libraries that run without an operating system, with each set of features to build.
const LIBRARIES: [(&str, &[&str]); 8] = [
    ("condor-dev", &["", "conformance,riscv"]),
    ("condor-fs", &["", "dev"]),
    ("condor-hand", &["", "mbox,sim"]),
    ("condor-host", &[""]),
    ("condor-mbox", &["", "conformance,riscv"]),
    ("condor-mos", &["", "conformance,cortex-m,riscv"]),
    ("condor-tty", &["", "dev"]),
    ("utah-mit-hand", &[""]),
];

/// Nothing is run; the manifest has these optimized for the tests.
const UNOPTIMIZED: &str = "--config profile.dev.package.condor-hand.opt-level=0 \
                           --config profile.dev.package.utah-mit-hand.opt-level=0";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let mut targets = String::new();
    for target in TARGETS {
        need_target(context, target)?;
        targets += " --target ";
        targets += target;
    }
    let mut builds = 0;
    for (library, feature_sets) in LIBRARIES {
        for features in feature_sets {
            let features = if features.is_empty() {
                String::new()
            } else {
                format!("--features {features}")
            };
            let line = format!(
                "cargo build {UNOPTIMIZED} -p {library} --lib --no-default-features {features} {targets}"
            );
            command(context, &line).run()?;
            builds += TARGETS.len();
        }
    }
    Ok(Summary::of(format!(
        "{builds} builds for {} targets",
        TARGETS.len()
    )))
}
