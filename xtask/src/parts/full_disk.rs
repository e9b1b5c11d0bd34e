//! What kills servers, hosts and peers, on a disk that is filled and freed at random meanwhile
//! (`suites/full-disk`).

use std::time::{Duration, Instant};

use crate::Result;
use crate::command::command;
use crate::context::Context;
use crate::outcome::Summary;
use crate::parts::test;
use crate::programs;
use crate::tools::{is_root, need_debian};

/// Where a small disk is mounted.
const DISK: &str = "target/full-disk";
/// Each example with the kind of its disk, where that is, and what the example is told.
#[rustfmt::skip]
const EXAMPLES: [(&str, &str, &str, &str); 3] = [
    ("file_faults", "ext4", DISK, "--kills 300 --directory target/full-disk"),
    ("terminal_faults", "ext4", DISK, "--kills 100 --directory target/full-disk"),
    // Named systems are there.
    ("mailbox_faults", "tmpfs", "/dev/shm", "--kills 12 --stops 6 --rounds 20"),
];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    if !is_root() {
        return Ok(Summary::skipped("only root can mount a disk"));
    }
    need_debian(context, "e2fsprogs", "mkfs.ext4", &[])?;
    std::fs::create_dir_all(context.root.join(DISK))?;
    let alone = "unshare --mount suites/full-disk";
    for (_, kind, place, _) in EXAMPLES {
        let nothing = command(context, &format!("{alone} {kind} {place} true"));
        if let Err(problem) = nothing.run() {
            return Ok(Summary::skipped(format!("no disk: {problem}")));
        }
    }
    // Examples are built with the tests.
    programs::build(&command(context, &test::build_line()))?;
    // Twenty minutes together; else one run of each.
    let enough = Duration::from_secs(if context.whole { 400 } else { 0 });
    let mut runs = 0;
    for (name, kind, place, told) in EXAMPLES {
        let begun = Instant::now();
        for seed in 1.. {
            let example = format!("target/debug/examples/{name} --seed {seed} {told}");
            command(context, &format!("{alone} {kind} {place} {example}")).run()?;
            runs += 1;
            if begun.elapsed() >= enough {
                break;
            }
        }
    }
    let names = EXAMPLES.map(|(name, ..)| name).join(", ");
    Ok(Summary::of(format!("{names}: {runs} runs, nothing lost")))
}
