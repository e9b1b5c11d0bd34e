//! The firmwares end QEMU by themselves; one that hangs is stopped, by the id of its process.

use std::io::Read as _;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use crate::Result;
use crate::context::Context;
use crate::firmware::{FIRMWARES, Firmware};
use crate::outcome::Summary;
use crate::tools::need_debian;

/// A run takes about a second; a busy machine may need some more.
const LIMIT: Duration = Duration::from_secs(120);

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let mut checked = Vec::new();
    for firmware in &FIRMWARES {
        // A newer qemu-utils, from a distribution's backports, keeps the package out.
        need_debian(context, firmware.debian, firmware.qemu, &["qemu-utils"])?;
        let image = firmware.build(context, "conformance,values")?;
        let (output, ended) = emulate(firmware, &image)?;
        match judge(&output, ended) {
            Ok(passed) => checked.push(format!(
                "{} for {} with {passed} checks",
                firmware.package, firmware.target
            )),
            Err(problem) => {
                eprintln!("{output}");
                return Err(
                    format!("{} for {}: {problem}", firmware.package, firmware.target).into(),
                );
            }
        }
    }
    Ok(Summary::of(checked.join(", ")))
}

/// What the firmware printed, and how QEMU ended; `None` if it had to be stopped.
fn emulate(firmware: &Firmware, image: &Path) -> Result<(String, Option<ExitStatus>)> {
    eprintln!(
        "$ {} {} -kernel {}",
        firmware.qemu,
        firmware.machine,
        image.display()
    );
    let mut child = Command::new(firmware.qemu)
        .args(firmware.machine.split_whitespace())
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| format!("{} could not be started: {error}", firmware.qemu))?;
    let mut output = child.stdout.take().ok_or("QEMU has no output")?;
    let (send, ended) = mpsc::channel();
    let reader = thread::spawn(move || {
        let mut bytes = Vec::new();
        // What was read before an error is worth showing.
        let _ = output.read_to_end(&mut bytes);
        // Nobody waits any more if the limit has passed.
        let _ = send.send(());
        String::from_utf8_lossy(&bytes).into_owned()
    });
    let in_time = ended.recv_timeout(LIMIT) != Err(RecvTimeoutError::Timeout);
    if !in_time {
        child.kill()?;
    }
    let status = child.wait()?;
    let printed = reader.join().map_err(|_| "the output cannot be read")?;
    Ok((printed, in_time.then_some(status)))
}

/// The number of checks that passed, if all did and the firmware said so itself.
fn judge(output: &str, ended: Option<ExitStatus>) -> Result<u32> {
    let Some(status) = ended else {
        return Err(format!("not done after {} s", LIMIT.as_secs()).into());
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

    use super::judge;

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
