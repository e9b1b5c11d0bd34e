//! Builds the firmwares and runs them in QEMU.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use crate::Result;
use crate::build::{self, tool};

const TARGET: &str = "thumbv7m-none-eabi";
const QEMU: &str = "qemu-system-arm";
const MACHINE: &str = "mps2-an385";

/// An instruction takes 2⁷ ns, more than three ticks of the counter: no count is ambiguous.
pub(crate) const ICOUNT_SHIFT: u32 = 7;

/// The firmwares, built.
pub(crate) struct Workspace {
    images: PathBuf,
}

impl Workspace {
    /// Builds all firmwares for release.
    ///
    /// # Errors
    /// Returns an error if a tool is missing, or if a firmware does not build.
    pub(crate) fn build() -> Result<Self> {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware");
        let images = build::images(&dir, TARGET, &["calibration", "condor-loops", "rtic-loops"])?;
        Ok(Self { images })
    }

    /// Runs the firmware of a package and returns the text that it printed.
    ///
    /// # Errors
    /// Returns an error if QEMU is missing, or if the firmware fails.
    pub(crate) fn run(&self, package: &str) -> Result<String> {
        let how = format!("apt-get install --no-install-recommends {QEMU}");
        let output = tool(QEMU, &how, |qemu| {
            qemu.args(["-machine", MACHINE, "-icount"])
                .arg(format!("shift={ICOUNT_SHIFT},sleep=off"))
                .args(["-display", "none", "-serial", "none", "-monitor", "none"])
                .args(["-semihosting-config", "enable=on,target=native"])
                .arg("-kernel")
                .arg(self.images.join(package))
                .stdin(Stdio::null())
                .output()
        })?;
        let text = String::from_utf8(output.stdout)?;
        if output.status.success() {
            Ok(text)
        } else {
            Err(format!("{package} failed ({}): {text}", output.status).into())
        }
    }
}
