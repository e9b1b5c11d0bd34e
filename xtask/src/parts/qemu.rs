//! The firmwares end QEMU by themselves; one that hangs is stopped, by the id of its process.
//!
//! A line `echo` with a number asks for so many bytes, each of which the firmware sends back.

use std::io::{BufRead, BufReader, Read as _, Write};
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use crate::Result;
use crate::command::{side_by_side, timed};
use crate::context::Context;
use crate::firmware::{self, MACHINES, Machine};
use crate::parts::Summary;
use crate::tools::{need_qemu, need_target};

/// A run takes about a second; a busy machine may need some more.
const LIMIT: Duration = Duration::from_secs(120);

/// Optimized, but not as a whole: nobody searches these images.
const PROFILE: &str = "emulated";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    for machine in &MACHINES {
        need_qemu(context, machine.qemu)?;
        need_target(context, machine.target)?;
    }
    let mut images = Vec::new();
    for machine in &MACHINES {
        // With every check.
        let selection = Machine::selection(machine.programs) + " --features conformance,values";
        let folder = firmware::build(context, &selection, machine.target, PROFILE)?;
        let programs = machine.programs.iter();
        images.extend(programs.map(|program| (machine, program, folder.join(program))));
    }
    let checked = side_by_side(&images, |(machine, program, image)| {
        timed(program, || check(machine, program, image))
    })?;
    Ok(Summary::of(checked.join(", ")))
}

/// Runs a program, and tells how many checks it has made.
fn check(machine: &Machine, program: &str, image: &Path) -> Result<String> {
    let target = machine.target;
    let (output, ended) = emulate(machine, image)?;
    match judge(&output, ended) {
        Ok(passed) => Ok(format!("{program} for {target} with {passed} checks")),
        Err(problem) => {
            eprintln!("{output}");
            Err(format!("{program} for {target}: {problem}").into())
        }
    }
}

/// Returns the output of the firmware, and how QEMU ended; `None` if it had to be stopped.
fn emulate(machine: &Machine, image: &Path) -> Result<(String, Option<ExitStatus>)> {
    let Machine { qemu, options, .. } = machine;
    eprintln!("$ {qemu} {options} -kernel {}", image.display());
    let mut child = Command::new(qemu)
        .args(options.split_whitespace())
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| format!("{qemu} could not be started: {error}"))?;
    let output = child.stdout.take().ok_or("QEMU has no output")?;
    let input = child.stdin.take().ok_or("QEMU has no input")?;
    let (send, ended) = mpsc::channel();
    let reader = thread::spawn(move || {
        let printed = listen(BufReader::new(output), input);
        // Nobody waits any more if the limit has passed.
        let _ = send.send(());
        printed
    });
    let in_time = ended.recv_timeout(LIMIT) != Err(RecvTimeoutError::Timeout);
    if !in_time {
        child.kill()?;
    }
    let status = child.wait()?;
    let printed = reader.join().map_err(|_| "the output cannot be read")?;
    Ok((printed, in_time.then_some(status)))
}

/// Returns the output of the firmware until it ends, with a verdict in place of the bytes that it echoes.
fn listen(mut output: impl BufRead, mut input: impl Write + Send) -> String {
    let (mut printed, mut line) = (Vec::new(), Vec::new());
    let mut failed = false;
    // The output read before an error is worth showing.
    while output
        .read_until(b'\n', &mut line)
        .is_ok_and(|read| read > 0)
    {
        if let Some(count) = echo_wanted(&line) {
            let verdict = match exchange(count, &mut output, &mut input) {
                Ok(()) => format!("  ok      {count} bytes came back\n"),
                Err(problem) => format!("  FAILED  {problem}\n"),
            };
            failed |= verdict.contains("FAILED");
            line = verdict.into_bytes();
        }
        printed.append(&mut line);
    }
    if failed {
        printed.extend(b"0 passed, 1 failed\n");
    }
    String::from_utf8_lossy(&printed).into_owned()
}

/// Returns the number of bytes that a line asks for.
fn echo_wanted(line: &[u8]) -> Option<usize> {
    let line = std::str::from_utf8(line).ok()?;
    line.trim_end().strip_prefix("echo ")?.parse().ok()
}

/// Sends bytes, and sees that they come back.
fn exchange(
    count: usize,
    output: &mut impl BufRead,
    input: &mut (impl Write + Send),
) -> Result<()> {
    let bytes: Vec<u8> = noise().take(count).collect();
    let mut back = Vec::with_capacity(count);
    thread::scope(|scope| {
        let sender = scope.spawn(|| input.write_all(&bytes).and_then(|()| input.flush()));
        let received = output.take(count as u64).read_to_end(&mut back);
        // If the firmware has ended, the pipe is broken.
        let sent = sender.join().map_err(|_| "the sender panicked")?;
        received?;
        sent?;
        Ok::<(), Box<dyn std::error::Error>>(())
    })?;
    match bytes
        .iter()
        .zip(&back)
        .position(|(sent, came)| sent != came)
    {
        Some(at) => Err(format!(
            "byte {at}, counted from 0, of the {count} bytes that were sent came back changed"
        )
        .into()),
        None if back.len() < count => Err(format!(
            "only {} of the {count} bytes that were sent came back",
            back.len()
        )
        .into()),
        None => Ok(()),
    }
}

/// Yields bytes of all values in no order (xorshift; Marsaglia, 2003).
fn noise() -> impl Iterator<Item = u8> {
    let step = |state: &u32| {
        let state = state ^ state << 13;
        let state = state ^ state >> 17;
        Some(state ^ state << 5)
    };
    std::iter::successors(Some(0x9e37_79b9), step).map(|state| (state >> 24) as u8)
}

/// Returns the number of checks that passed, if all did and the firmware said so itself.
fn judge(output: &str, ended: Option<ExitStatus>) -> Result<u32> {
    let Some(status) = ended else {
        return Err(format!("the firmware had not ended after {} s", LIMIT.as_secs()).into());
    };
    let last = output.lines().last().unwrap_or("it printed nothing").trim();
    let passed = match last.split_once(" passed, ") {
        Some((passed, "0 failed")) => passed.parse()?,
        _ => 0,
    };
    if passed == 0 || !status.success() {
        return Err(format!("{last} ({status})").into());
    }
    Ok(passed)
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::ExitStatus;

    use super::{judge, listen, noise};

    /// Listens to a firmware that echoes the noise, spoilt by `spoil`; returns the output, and the bytes
    /// that were sent.
    fn echoing(count: usize, spoil: impl FnOnce(&mut Vec<u8>)) -> (String, Vec<u8>) {
        let mut bytes: Vec<u8> = noise().take(count).collect();
        spoil(&mut bytes);
        let mut output = format!("echo {count}\n").into_bytes();
        output.extend(bytes);
        output.extend(b"1 passed, 0 failed\n");
        let mut sent = Vec::new();
        (listen(&output[..], &mut sent), sent)
    }

    #[test]
    fn every_byte_must_come_back() {
        let (printed, sent) = echoing(1000, |_| {});
        assert_eq!(sent, noise().take(1000).collect::<Vec<_>>());
        assert!(printed.ends_with("bytes came back\n1 passed, 0 failed\n"));
        let other = |bytes: &mut Vec<u8>| bytes[500] ^= 1;
        assert!(echoing(1000, other).0.contains("byte 500"));
        let lost = |bytes: &mut Vec<u8>| bytes.truncate(999);
        assert!(echoing(1000, lost).0.ends_with("0 passed, 1 failed\n"));
    }

    #[test]
    fn believes_the_last_line_and_the_status_only_together() {
        let (well, ill) = (ExitStatus::from_raw(0), ExitStatus::from_raw(1 << 8));
        let all = "  ok  this\n7 passed, 0 failed\n";
        assert_eq!(judge(all, Some(well)).unwrap(), 7);
        assert!(judge(all, Some(ill)).is_err());
        assert!(judge(all, None).is_err());
        assert!(judge("6 passed, 1 failed\n", Some(well)).is_err());
        assert!(judge("0 passed, 0 failed\n", Some(well)).is_err());
        assert!(judge("", Some(well)).is_err());
    }
}
