//! Builds the firmwares and runs them in QEMU.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use crate::Result;
use crate::firmware::{self, tool};

const TARGET: &str = "thumbv7m-none-eabi";
const QEMU: &str = "qemu-system-arm";
const MACHINE: &str = "mps2-an385";

/// An instruction takes 2⁷ ns, more than three ticks of the counter: no count is ambiguous.
pub(crate) const ICOUNT_SHIFT: u32 = 7;

/// A firmware takes a second; one that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(60);
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// The firmwares, built.
pub(crate) struct Workspace {
    images: PathBuf,
}

impl Workspace {
    /// Builds all firmwares for release.
    ///
    /// # Errors
    /// A tool is missing, or a firmware does not build.
    pub(crate) fn build() -> Result<Self> {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware");
        let images = firmware::build(&dir, TARGET, &[])?;
        Ok(Self { images })
    }

    /// Runs the firmware of a package and gives back what it printed.
    ///
    /// # Errors
    /// QEMU is missing, or the firmware fails or does not end.
    pub(crate) fn run(&self, package: &str) -> Result<String> {
        let how = format!("apt-get install --no-install-recommends {QEMU}");
        let mut child = tool(QEMU, &how, |qemu| {
            qemu.args(["-machine", MACHINE, "-icount"])
                .arg(format!("shift={ICOUNT_SHIFT},sleep=off"))
                .args(["-display", "none", "-serial", "none", "-monitor", "none"])
                .args(["-semihosting-config", "enable=on,target=native"])
                .arg("-kernel")
                .arg(self.images.join(package))
                .stdin(Stdio::null())
                .stdout(Stdio::piped())
                .spawn()
        })?;
        let output = child.stdout.take();
        let reader = thread::spawn(move || {
            let mut text = String::new();
            output.map(|mut output| output.read_to_string(&mut text));
            text
        });
        let deadline = Instant::now() + PATIENCE;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break Some(status);
            }
            if Instant::now() >= deadline {
                child.kill()?;
                child.wait()?;
                break None;
            }
            thread::sleep(LOOK_AGAIN);
        };
        let text = reader.join().unwrap_or_default();
        match status {
            Some(status) if status.success() => Ok(text),
            Some(status) => Err(format!("{package} failed ({status}): {text}").into()),
            None => Err(format!("{package} did not end within {PATIENCE:?}: {text}").into()),
        }
    }
}
