//! The table of the parts. A new one is a file in `parts/` with a `run` and a line here.

use crate::Result;
use crate::context::Context;
use crate::outcome::Summary;

mod deny;
mod docs;
mod features;
mod fmt;
mod full_disk;
mod fuzz;
mod lint;
mod loom;
mod miri;
mod msrv;
mod mujoco;
mod no_std;
mod panics;
mod qemu;
mod riscv;
mod suites;
mod test;
mod unsafe_code;

/// One check of the workspace, and a sub-command of `cargo xtask`.
///
/// A part that finds nothing to check fails: what was lost by accident must not look checked.
pub(crate) struct Part {
    pub name: &'static str,
    pub about: &'static str,
    pub run: fn(&Context) -> Result<Summary>,
}

/// All parts, in the order of `verify`: what answers quickly comes first.
#[rustfmt::skip]
pub(crate) const PARTS: &[Part] = &[
    Part { name: "fmt",      about: "rustfmt, in every workspace",                     run: fmt::run },
    Part { name: "lint",     about: "clippy over all targets, in every workspace",     run: lint::run },
    Part { name: "docs",     about: "rustdoc without warnings",                        run: docs::run },
    Part { name: "unsafe",   about: "the READMEs' tables of unsafe code",              run: unsafe_code::run },
    Part { name: "test",     about: "the tests as README.md says to run them",         run: test::run },
    Part { name: "suites",   about: "fsx and pjdfstest over condor-fs, while its server is killed", run: suites::run },
    Part { name: "full-disk", about: "faults of fs, tty and mbox on a disk that fills up", run: full_disk::run },
    Part { name: "mujoco",   about: "the hand's controllers around a plant in MuJoCo",  run: mujoco::run },
    Part { name: "no-std",   about: "the libraries, built for bare-metal targets",     run: no_std::run },
    Part { name: "qemu",     about: "the bare-metal firmwares, run in QEMU",           run: qemu::run },
    Part { name: "riscv",    about: "the hand on bare-metal harts in QEMU, and drills", run: riscv::run },
    Part { name: "panics",   about: "no path that panics in the linked firmwares",     run: panics::run },
    Part { name: "features", about: "clippy with each two features, and each alone",      run: features::run },
    Part { name: "deny",     about: "licences, duplicates, sources, advisories",       run: deny::run },
    Part { name: "msrv",     about: "the oldest toolchain that the manifests promise", run: msrv::run },
    Part { name: "loom",     about: "the concurrency models: tests named loom",        run: loom::run },
    Part { name: "miri",     about: "unit tests without undefined behaviour",          run: miri::run },
    Part { name: "fuzz",     about: "every fuzz target for a bounded time",            run: fuzz::run },
];
