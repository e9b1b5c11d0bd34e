//! `dev`: what a write to a device costs beside the driver's own instructions.
//!
//! Sixteen bits go to the same register of the same driver on the same bus, which is plain memory,
//! by each way: the driver called directly, the descriptor, a switch of trait objects that checks
//! descriptors in the same way, rust-vmm's device manager. Instructions are counted by callgrind,
//! from the first of the function that goes that way to its return; they are the same every time,
//! so there are no rounds and their intervals have no width. Time is that of the descriptor's way
//! beside write(2) of the same two bytes to `/dev/null`.

mod boards;
mod paths;
mod peers;

use std::fs::OpenOptions;
use std::hint::black_box;

use crate::Result;
use crate::callgrind;
use crate::measure::{Estimate, Goal, Report};
use crate::options::Options;
use crate::race::Race;

pub(crate) use paths::go;

const ONE_CALL: &str = "one call";
const BY_FD: &str = "switch, by descriptor";
const WRITE2: &str = "write(2) to /dev/null";

/// Counts and times all paths.
///
/// # Errors
/// Returns an error if valgrind is missing or fails.
pub(crate) fn run(options: &Options) -> Result<Report> {
    let mut text = String::new();
    let [direct, fd, dynamic, _, direct16, typed, putc, ..] = callgrind::table(
        &mut text,
        ONE_CALL,
        [
            ("direct", "driver, called directly"),
            ("fd", BY_FD),
            ("dyn", "switch of trait objects"),
            ("vm_device", "rust-vmm vm-device"),
            ("direct16", "16-bit call, directly"),
            ("typed", "16-bit call of the typed device"),
            ("putc", "BufWriter, a byte"),
            ("std_buf_writer", "std's BufWriter, a byte"),
            ("output", "shared Output, 16 bytes"),
        ],
    )?;
    let (switch, port) = paths::open()?;
    let null = OpenOptions::new().write(true).open("/dev/null")?;
    let bytes = |call: usize| (call as u16).to_ne_bytes();
    let written = |well| {
        if well {
            Ok(())
        } else {
            Err("a write failed".into())
        }
    };
    let mut race = Race::new();
    race.enter_failing(ONE_CALL, BY_FD, |call| {
        written(paths::condor_path_fd(switch, port, black_box(&bytes(call))))
    });
    race.enter_failing(ONE_CALL, WRITE2, |call| {
        written(rustix::io::write(&null, black_box(&bytes(call)))? == 2)
    });
    let times = race.run(options.rounds(31, 9))?;
    text += &times.to_string();
    let write2 = times.ratio(&[(ONE_CALL, WRITE2, 0)], &[(ONE_CALL, BY_FD, 0)])?;
    let lower = |name, value, limit| Goal::most(name, Estimate::exactly(value), limit);
    let goals = vec![
        lower("fd_over_direct", fd - direct, 25.0),
        lower("fd_vs_dyn", fd / dynamic, 0.9),
        lower("typed_over_direct", typed - direct16, 0.0),
        lower("putc", putc, 20.0),
        Goal::least("write2_vs_fd", write2, 10.0),
    ];
    Ok(Report { text, goals })
}
