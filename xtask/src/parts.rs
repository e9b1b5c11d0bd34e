//! The table of the parts. A new one is a file in `parts/` with a `run` and a line here.

use crate::Result;
use crate::context::Context;

mod attack;
mod deny;
mod docs;
mod features;
mod fmt;
mod full_disk;
mod fuzz;
mod imports;
mod lint;
mod live;
mod loom;
mod miri;
mod mujoco;
mod no_std;
mod page;
mod panics;
mod pictures;
mod python;
mod qemu;
mod reach;
mod recordings;
mod remote;
mod riscv;
mod seeds;
mod suites;
mod template;
mod test;
mod unsafe_code;
mod words;

/// One check of the workspace, and a sub-command of `cargo xtask`.
///
/// A part that finds nothing to check fails: what was lost by accident must not look checked.
pub(crate) struct Part {
    pub name: &'static str,
    pub about: &'static str,
    pub run: fn(&Context) -> Result<Summary>,
    /// True if `verify` runs it; others are run by a person alone.
    pub in_verify: bool,
}

impl Part {
    const fn new(
        name: &'static str,
        about: &'static str,
        run: fn(&Context) -> Result<Summary>,
    ) -> Self {
        Self {
            name,
            about,
            run,
            in_verify: true,
        }
    }
}

/// The things that a part that passed has checked, and those that it had to leave out.
pub(crate) struct Summary {
    pub checked: String,
    pub left_out: Option<String>,
    pub skipped: bool,
}

impl Summary {
    /// Makes the summary of a part all of whose checks were made.
    pub(crate) fn of(checked: impl Into<String>) -> Self {
        Self {
            checked: checked.into(),
            left_out: None,
            skipped: false,
        }
    }

    /// Makes the summary of a part of which nothing could be checked on this machine.
    pub(crate) fn skipped(why: impl Into<String>) -> Self {
        Self {
            skipped: true,
            ..Self::of(why)
        }
    }

    /// Notes a thing that could not be checked on this machine, which the summary line says in capitals.
    pub(crate) fn leaving_out(self, what: impl Into<String>) -> Self {
        Self {
            left_out: Some(what.into()),
            ..self
        }
    }
}

/// All parts, in the order of `verify`: what answers quickly comes first.
#[rustfmt::skip]
pub(crate) const PARTS: &[Part] = &[
    Part::new("test", "the tests as README.md says to run them", test::run),
    Part::new("fmt", "rustfmt, in every workspace", fmt::run),
    Part::new("unsafe", "the READMEs' tables of unsafe code", unsafe_code::run),
    Part::new("imports", "cycles of imports, in every workspace", imports::run),
    Part::new("words", "rules for docs, comments, READMEs, help and error texts", words::run),
    Part::new("docs", "rustdoc without warnings", docs::run),
    Part::new("lint", "clippy over all targets (with `--whole` in every workspace)", lint::run),
    Part::new("features", "each feature (with `--whole` each two), with the oldest toolchain", features::run),
    Part::new("no-std", "the libraries, built for bare-metal targets", no_std::run),
    Part::new("suites", "fsx and pjdfstest over condor-fs, while its server is killed", suites::run),
    Part::new("full-disk", "faults of fs, mbox and tty on a disk that fills up, and beside the hand", full_disk::run),
    Part::new("mujoco", "the hand's controllers around a plant in MuJoCo", mujoco::run),
    Part::new("live", "the live server, with a client in Python", live::run),
    Part::new("page", "the page of the live server, in Chromium", page::run),
    Part::new("recordings", "a recording of the hand, read by rosbags and mcap-ros2-support", recordings::run),
    Part::new("python", "the Python package, with the hand in simulated time", python::run),
    Part::new("remote", "the gateway and its clients, while everything is killed", remote::run),
    Part::new("attack", "the hand as processes, while they are killed, stopped and taken down", attack::run),
    Part::new("qemu", "the bare-metal firmwares, run in QEMU", qemu::run),
    Part::new("panics", "no path that panics in the linked firmwares", panics::run),
    Part::new("riscv", "the hand on bare-metal harts in QEMU, and drills", riscv::run),
    Part::new("template", "the template, made outside of the tree, as processes and on a hart", template::run),
    Part::new("reach", "modules of the libraries that no program reaches", reach::run),
    Part::new("deny", "licences, duplicates, sources, advisories", deny::run),
    Part::new("loom", "the concurrency models: tests named loom", loom::run),
    Part::new("miri", "unit tests without undefined behaviour", miri::run),
    Part::new("seeds", "the seeds of the fuzz targets, replayed", seeds::run),
    Part { in_verify: false, ..Part::new("pictures", "the READMEs' pictures of the user interface, made anew", pictures::run) },
    Part { in_verify: false, ..Part::new("fuzz", "every fuzz target with sanitizers, for a time", fuzz::run) },
];
