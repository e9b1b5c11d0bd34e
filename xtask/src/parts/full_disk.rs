//! The tests that kill servers, hosts and peers, on a disk that is filled and freed at random meanwhile
//! (`suites/full-disk`); and the hand while its services and its user interface are killed.

use std::time::{Duration, Instant};

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::parts::test;
use crate::tools::{is_root, need_debian};

/// The place where a small disk is mounted.
const DISK: &str = "target/full-disk";
/// The crate of each test `faults`, the kind of its disk, where that is, and what the test is told.
#[rustfmt::skip]
const TESTS: [(&str, &str, &str, &str); 3] = [
    ("condor-fs", "ext4", DISK, "--kills 300 --directory target/full-disk"),
    ("condor-tty", "ext4", DISK, "--kills 100 --directory target/full-disk"),
    // Named systems are there.
    ("condor-mbox", "tmpfs", "/dev/shm", "--kills 12 --stops 6 --rounds 20"),
];

pub(crate) fn run(context: &Context) -> Result<Summary> {
    if !is_root() {
        return Ok(Summary::skipped("only root can mount a disk"));
    }
    need_debian(context, "e2fsprogs", "mkfs.ext4")?;
    std::fs::create_dir_all(context.root.join(DISK))?;
    let alone = "unshare --mount tests/suites/full-disk";
    for (_, kind, place, _) in TESTS {
        let nothing = context.command(&format!("{alone} {kind} {place} true"));
        if let Err(problem) = nothing.run() {
            return Ok(Summary::skipped(format!(
                "no small disk can be mounted: {problem}"
            )));
        }
    }
    let built = test::build(context)?;
    // Twenty minutes together; else one run of each.
    let enough = Duration::from_secs(if context.options.whole { 400 } else { 0 });
    let mut runs = 0;
    for (package, kind, place, told) in TESTS {
        let mut tests = built.iter();
        let test = tests.find(|test| (&*test.package, &*test.name) == (package, "faults"));
        let test = test.ok_or_else(|| format!("{package} has no test `faults`"))?;
        let test = test.path.display();
        let begun = Instant::now();
        for seed in 1.. {
            let line = format!("{alone} {kind} {place} {test} --seed {seed} {told}");
            context.command(&line).run()?;
            runs += 1;
            if begun.elapsed() >= enough {
                break;
            }
        }
    }
    let kills = format!(
        "target/debug/examples/kills --for {}s",
        enough.as_secs().max(5)
    );
    context.command(&kills).run()?;
    let names = TESTS.map(|(package, ..)| package).join(", ");
    Ok(Summary::of(format!(
        "faults of {names}: {runs} runs, and kills beside the hand; nothing lost"
    )))
}
