//! The examples `faults`, which kill servers, hosts and peers, on a disk that is filled and freed at
//! random meanwhile (`suites/full-disk`).

use std::time::{Duration, Instant};

use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::tools::{is_root, need_debian};

/// Where a small disk is mounted.
const DISK: &str = "target/full-disk";
/// Each crate with the kind of its disk, where it is, and what `faults` is told.
const FAULTS: [(&str, &str, &str, &str); 3] = [
    (
        "condor-fs",
        "ext4",
        DISK,
        "--kills 300 --directory target/full-disk",
    ),
    (
        "condor-tty",
        "ext4",
        DISK,
        "--kills 100 --directory target/full-disk",
    ),
    // Named systems are in the memory that is mounted there.
    (
        "condor-mbox",
        "tmpfs",
        "/dev/shm",
        "--kills 12 --stops 6 --rounds 20",
    ),
];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let names = FAULTS.map(|(name, ..)| name).join(", ");
    if !is_root() {
        return Ok(Summary::of("nothing").leaving_out("ALL, as only root can mount a disk"));
    }
    need_debian(context, "e2fsprogs", "mkfs.ext4", &[])?;
    std::fs::create_dir_all(context.root.join(DISK))?;
    let alone = "unshare --mount suites/full-disk";
    for (_, kind, place, _) in FAULTS {
        let nothing = command(context, &format!("{alone} {kind} {place} true"));
        if let Err(problem) = nothing.run() {
            return Ok(Summary::of("nothing").leaving_out(format!("ALL, no disk: {problem}")));
        }
    }
    // Twenty minutes together; else one run each.
    let enough = Duration::from_secs(if context.whole { 400 } else { 0 });
    let mut runs = 0;
    for (name, kind, place, told) in FAULTS {
        command(
            context,
            &format!("cargo build -p {name} --all-features --example faults"),
        )
        .run()?;
        let begun = Instant::now();
        for seed in 1.. {
            let faults = format!("target/debug/examples/faults --seed {seed} {told}");
            command(context, &format!("{alone} {kind} {place} {faults}")).run()?;
            runs += 1;
            if begun.elapsed() >= enough {
                break;
            }
        }
    }
    Ok(Summary::of(format!("{names}: {runs} runs, nothing lost")))
}
