//! `riscv-instructions`: what a release, a message and an interrupt cost on a hart, in instructions.
//!
//! The drill `instructions` of `tests/bench/drills/hart` runs on one hart of QEMU's machine `virt`, under
//! `-icount`, on the way that every program of a hart takes: its trap entry, its timer, its mailbox. It
//! counts by itself, with `minstret`, and publishes what it found; here that is believed, or not.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use drills::alone::Alone;
use drills::instructions::{Counts, NAME};

use crate::Result;
use crate::build;
use crate::measure::Report;
use crate::options::Options;

const TARGET: &str = "riscv64gc-unknown-none-elf";
/// An instruction takes 2⁰ ns, which is what the emulator counts in.
const SHIFT: u8 = 0;
const PATIENCE: Duration = Duration::from_secs(120);

/// Builds the images, and has the hart count twice.
///
/// # Errors
/// Returns an error if a tool is missing, if the hart does not come to an end, if it counts known sequences
/// as something else, or if its two counts differ.
pub(crate) fn run(_: &Options) -> Result<Report> {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware");
    let images = build::images(&dir, TARGET, &["monitor", "drills-hart"])?;
    let counts = count(&images)?;
    check(&counts)?;
    let again = count(&images)?;
    if again != counts {
        return Err(format!("two runs count differently: {counts:?}, {again:?}").into());
    }
    Ok(Report {
        text: table(&counts)?,
        goals: Vec::new(),
    })
}

fn count(images: &Path) -> Result<Counts> {
    let hart = Alone::new(1, &images.join("drills-hart"), &["instructions"])?;
    hart.play(&images.join("monitor"), SHIFT, PATIENCE)?;
    let counts = drills::published(&hart.region(0)?, NAME)?;
    Ok(counts.ok_or("the hart has published nothing")?)
}

/// Compares counts of known sequences with their lengths.
///
/// # Errors
/// Returns an error if a count is off, so that nothing could be said of anything else.
fn check(counts: &Counts) -> Result<()> {
    let known = [
        (
            "a sequence of nops",
            counts.sequence_counted,
            counts.sequence,
        ),
        (
            "a trap handler, run again and again,",
            counts.handler_counted,
            counts.handler.wrapping_mul(counts.handler_runs),
        ),
    ];
    for (what, found, known) in known {
        if found != known {
            let off = format!("{what} is {known} instructions and was counted as {found}");
            return Err(format!("calibration is off: {off}").into());
        }
    }
    let (ran, due) = (
        counts.releases,
        counts.hyperperiods.wrapping_mul(counts.releases_each),
    );
    if ran != due || ran == 0 || counts.messages == 0 || counts.interrupts == 0 {
        return Err(format!("{ran} releases ran where {due} were due").into());
    }
    Ok(())
}

fn table(counts: &Counts) -> Result<String> {
    let each = |all: u32, number: u32| f64::from(all) / f64::from(number);
    let with_body = each(counts.releases_counted, counts.releases);
    let mut text = String::new();
    writeln!(
        text,
        "calibration: {} instructions counted as {}, {} runs of a handler of {} as {}; \
         two runs counted the same",
        counts.sequence,
        counts.sequence_counted,
        counts.handler_runs,
        counts.handler,
        counts.handler_counted,
    )?;
    writeln!(text, "\n{:50} {:>12}", "on a hart", "instructions")?;
    for (what, value) in [
        (
            "release of one of three loops",
            with_body - f64::from(counts.body),
        ),
        ("the same, with the body", with_body),
        (
            "message to itself, sent and served",
            each(counts.messages_counted, counts.messages),
        ),
        (
            "message to itself, with reply",
            each(counts.replies_counted, counts.messages),
        ),
        (
            "interrupt of a board, to its driver",
            each(counts.interrupts_counted, counts.interrupts),
        ),
    ] {
        writeln!(text, "{what:50} {value:12.2}")?;
    }
    writeln!(
        text,
        "\n{} releases, {} messages of each kind, {} interrupts",
        counts.releases, counts.messages, counts.interrupts
    )?;
    Ok(text)
}
