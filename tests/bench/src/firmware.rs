//! Builds what runs in QEMU.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::Result;

/// Builds packages of the workspace in `dir` for release, with its own lock file, or all of them if none is
/// named; returns the directory of the images.
///
/// # Errors
/// Returns an error if a tool is missing, or if a package does not build.
pub(crate) fn build(dir: &Path, target: &str, packages: &[&str]) -> Result<PathBuf> {
    let target_dir = dir.join("target");
    // Flags for this machine's compiler would reach the firmware's.
    let status = tool("cargo", "it comes with Rust: https://rustup.rs", |cargo| {
        cargo
            .args(["build", "--release", "--locked", "--target", target])
            .args(packages.iter().flat_map(|package| ["--package", package]))
            .arg("--target-dir")
            .arg(&target_dir)
            .current_dir(dir)
            .env_remove("RUSTFLAGS")
            .env_remove("CARGO_ENCODED_RUSTFLAGS")
            .stdout(Stdio::null())
            .status()
    })?;
    if !status.success() {
        let how = format!("is the target there? rustup target add {target}");
        return Err(format!("cargo in {} fails; {how}", dir.display()).into());
    }
    Ok(target_dir.join(target).join("release"))
}

/// Runs a tool. If it is not installed, the error says how to get it.
///
/// # Errors
/// Returns an error if the tool is missing, or cannot be run.
pub(crate) fn tool<T>(
    name: &str,
    how: &str,
    run: impl FnOnce(&mut Command) -> std::io::Result<T>,
) -> Result<T> {
    run(&mut Command::new(name)).map_err(|error| match error.kind() {
        ErrorKind::NotFound => format!("{name} is not installed: {how}").into(),
        _ => format!("{name}: {error}").into(),
    })
}
