//! Builds the firmwares and runs them in QEMU.

use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::Result;

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
    /// Builds all firmwares for release, with their own lock file.
    ///
    /// # Errors
    /// A tool is missing, or a firmware does not build.
    pub(crate) fn build() -> Result<Self> {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("firmware");
        let target_dir = dir.join("target");
        need_target()?;
        // Flags for this machine's compiler would reach the firmware's.
        let status = tool("cargo", "it comes with Rust: https://rustup.rs", |cargo| {
            cargo
                .args(["build", "--release", "--locked", "--target", TARGET])
                .arg("--target-dir")
                .arg(&target_dir)
                .current_dir(&dir)
                .env_remove("RUSTFLAGS")
                .env_remove("CARGO_ENCODED_RUSTFLAGS")
                .stdout(Stdio::null())
                .status()
        })?;
        if !status.success() {
            return Err(format!("the firmwares do not build: cargo in {}", dir.display()).into());
        }
        Ok(Self {
            images: target_dir.join(TARGET).join("release"),
        })
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

/// Installs the core library for the target if it is missing.
fn need_target() -> Result<()> {
    let library = tool("rustc", "it comes with Rust: https://rustup.rs", |rustc| {
        rustc
            .args(["--print", "target-libdir", "--target", TARGET])
            .output()
    })?;
    if Path::new(String::from_utf8_lossy(&library.stdout).trim()).is_dir() {
        return Ok(());
    }
    let how =
        format!("install the core library for {TARGET} in the way the compiler was installed");
    let status = tool("rustup", &how, |rustup| {
        rustup.args(["target", "add", TARGET]).status()
    })?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("rustup target add {TARGET} failed").into())
    }
}

/// Runs a tool, or says how to get it.
fn tool<T>(
    name: &str,
    how: &str,
    run: impl FnOnce(&mut Command) -> std::io::Result<T>,
) -> Result<T> {
    run(&mut Command::new(name)).map_err(|error| match error.kind() {
        ErrorKind::NotFound => format!("{name} is not installed: {how}").into(),
        _ => format!("{name}: {error}").into(),
    })
}
