//! Bare-metal harts beside this machine: a whole system of them runs in QEMU.

use std::env;
use std::fs;

use crate::Result;
use crate::context::Context;
use crate::firmware::{self, HART_IMAGES, HARTS_TARGET};
use crate::parts::Summary;
use crate::parts::test;
use crate::programs;
use crate::tools::{need_debian, need_qemu, need_target};

/// The number of runs of the hand: by the real clock a servo is late on a machine that is busy, and a
/// finger lets go.
const HAND_RUNS: u32 = 3;
/// The seconds for which the hand runs, and the harts whose time counts instructions.
const HAND_SECONDS: u32 = 10;
const EXACT_SECONDS: u32 = 5;
/// The joints whose tracking error the summary tells.
const JOINTS: u32 = 16;
/// The master's words if it cannot load the motion that its description has typed. Whether a motion
/// comes to its end is a question of time: a busy machine misses deadlines, which stops fingers.
const NO_MOTION: &str = "wave.motion:";
/// The robots that run on harts as they do in processes: the program, and the folder with descriptions that all move it
/// alike.
const ROBOTS: [(&str, &str, &[&str]); 4] = [
    ("one-finger", "one-finger", &["harts.toml", "system.toml"]),
    (
        "robots",
        "robots/motor-hand",
        &["harts.toml", "system.toml"],
    ),
    ("robots", "robots/wam-arm", &["harts.toml", "system.toml"]),
    (
        "utah-mit-hand",
        "utah-mit-hand",
        &[
            "harts.toml",
            "system.toml",
            "harts-one-servo.toml",
            "one-servo.toml",
            "harts-four-servos.toml",
            "four-servos.toml",
        ],
    ),
];
/// The text at the end of a motion, which comes in simulated time. The summary ends with a hash of all
/// positions of the joints.
const DONE: &str = " is done";
const HASH: &str = ": hash ";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_target(context, HARTS_TARGET)?;
    if let Err(problem) = need_qemu(context, "qemu-system-riscv64") {
        // A person without QEMU can check all else.
        if env::var_os("CI").is_some() {
            return Err(problem);
        }
        return Ok(Summary::skipped(problem.to_string()));
    }
    need_debian(context, "gdb-multiarch", "gdb-multiarch")?;
    // The images that `panics` searches, and the programs of `test`.
    let harts = firmware::packages(&HART_IMAGES);
    let images = firmware::build(context, &harts, HARTS_TARGET, "release")?;
    let mut tests = test::build(context)?;
    let hand = format!(
        "target/debug/utah-mit-hand up examples/utah-mit-hand/harts.toml --clock real --headless --for {HAND_SECONDS}s"
    );
    for run in 1.. {
        let (mut joints, mut has_motion) = (0, true);
        context.command(&hand).watch(|line| {
            joints += u32::from(is_tracking(line));
            has_motion &= !line.contains(NO_MOTION);
        })?;
        if joints == JOINTS && has_motion {
            break;
        }
        let seen = format!("`{hand}` shows {joints} joints of {JOINTS}, or had no motion");
        if run == HAND_RUNS {
            return Err(seen.into());
        }
        println!("{seen}; run {run} of {HAND_RUNS}");
    }
    let mut ran = 0;
    for (program, robot, descriptions) in ROBOTS {
        let mut first = None;
        for description in descriptions {
            let seen = moved(context, program, &format!("{robot}/{description}"))?;
            let expected = first.get_or_insert_with(|| seen.clone());
            // At least one motion, and the hash at the end.
            let is_whole = seen.len() > 1 && seen.last().is_some_and(|line| line.contains(HASH));
            if !is_whole || seen != *expected {
                return Err(format!(
                    "{robot} in simulated time: {expected:?} first, {seen:?} by {description}"
                )
                .into());
            }
            ran += 1;
        }
    }
    let [hart, process] = ["harts.toml", "condor.toml"].map(|it| samples(context, it));
    if hart? != process? {
        return Err("the experiment has other samples on a hart than as a process".into());
    }
    let images = images.display();
    let exact =
        format!("target/debug/drills exact {images}/monitor {images}/drills-hart {EXACT_SECONDS}");
    context.command(&exact).run()?;
    let mut passed = 0;
    for (name, filter) in [("harts", ""), ("hand", "on_harts::")] {
        let tests: Vec<_> = tests.extract_if(.., |test| test.name == name).collect();
        let count = programs::run(&tests, &["--ignored", filter])?;
        if count == 0 {
            return Err(format!("the programs of tests called `{name}` ran no test").into());
        }
        passed += count;
    }
    Ok(Summary::of(format!(
        "{ran} systems of four robots for {HAND_SECONDS} s, {EXACT_SECONDS} s of exact stress, {passed} tests"
    )))
}

/// Returns the last lines of a robot, run in simulated time.
fn moved(context: &Context, program: &str, description: &str) -> Result<Vec<String>> {
    let hand = format!(
        "target/debug/{program} up examples/{description} --clock simulated --speed max --headless --for {HAND_SECONDS}s"
    );
    let mut seen = Vec::new();
    context.command(&hand).watch(|line| {
        if line.contains(DONE) || line.contains(HASH) {
            seen.push(line.trim_end().to_owned());
        }
    })?;
    Ok(seen)
}

/// Returns the samples that the experiment writes.
fn samples(context: &Context, description: &str) -> Result<Vec<u8>> {
    const EXPERIMENT: &str = "examples/experiment";
    let line = format!(
        "target/debug/experiment up {EXPERIMENT}/{description} --speed max --headless --for 2s"
    );
    context.command(&line).run()?;
    let response = context.root.join(EXPERIMENT).join("files/response");
    let samples = fs::read(&response)?;
    // Another run must not be believed to have written it.
    fs::remove_file(response)?;
    Ok(samples)
}

/// Returns true if a line has a finger, a joint, and two angles.
fn is_tracking(line: &str) -> bool {
    let words: Vec<&str> = line.split_whitespace().collect();
    matches!(words[..], [_, _, rms, peak] if rms.parse::<f64>().is_ok() && peak.parse::<f64>().is_ok())
}

#[cfg(test)]
mod tests {
    use super::is_tracking;

    #[test]
    fn a_joint_has_two_angles() {
        assert!(is_tracking("thumb      distal          5.805     51.822"));
        assert!(!is_tracking("finger     joint         rms deg   peak deg"));
        assert!(!is_tracking("middle has a fault: middle.distal"));
    }
}
