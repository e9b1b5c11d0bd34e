//! Builds what is measured in processes of its own or in QEMU.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::Result;

/// Builds for release what the arguments name of the workspace in `dir`, with its own lock file; returns the
/// directory of the programs.
///
/// # Errors
/// Returns an error if cargo is missing, or if something does not build.
pub(crate) fn programs(dir: &Path, arguments: &[&str]) -> Result<PathBuf> {
    Ok(cargo(dir, |cargo| cargo.args(arguments))?.join("release"))
}

/// Builds packages of the workspace in `dir` for a target of bare metal; returns the directory of the images.
///
/// # Errors
/// Returns an error if cargo is missing, or if a package does not build.
pub(crate) fn images(dir: &Path, target: &str, packages: &[&str]) -> Result<PathBuf> {
    let built = cargo(dir, |cargo| {
        cargo.args(["--target", target]);
        // Flags for this machine's compiler would reach the firmware's.
        cargo
            .env_remove("RUSTFLAGS")
            .env_remove("CARGO_ENCODED_RUSTFLAGS");
        cargo.args(packages.iter().flat_map(|package| ["--package", package]))
    });
    let built = built
        .map_err(|error| format!("{error}; is the target there? rustup target add {target}"))?;
    Ok(built.join(target).join("release"))
}

/// Builds for release into the workspace's own `target`, which it returns.
fn cargo(dir: &Path, ask: impl FnOnce(&mut Command) -> &mut Command) -> Result<PathBuf> {
    let target = dir.join("target");
    let status = tool("cargo", "it comes with Rust: https://rustup.rs", |cargo| {
        cargo.args(["build", "--release", "--locked", "--target-dir"]);
        ask(cargo.arg(&target).current_dir(dir))
            .stdout(Stdio::null())
            .status()
    })?;
    if !status.success() {
        return Err(format!("cargo in {} fails", dir.display()).into());
    }
    Ok(target)
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
