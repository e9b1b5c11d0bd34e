//! The tools that the parts need on the machine: found, or else installed, or else asked for in words.

use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

use crate::Result;
use crate::command::Line;
use crate::context::Context;

/// Installs the standard library of a target for the toolchain in use, unless it is there.
pub(crate) fn need_target(context: &Context, target: &str) -> Result<()> {
    let installed = context.command("rustup target list --installed").read()?;
    if installed.lines().any(|line| line == target) {
        return Ok(());
    }
    install(&context.command(&format!("rustup target add {target}")))
}

/// Installs a toolchain, such as `nightly` or `1.88`, unless it is there.
pub(crate) fn need_toolchain(context: &Context, toolchain: &str) -> Result<()> {
    let installed = context.command("rustup toolchain list").read()?;
    if installed
        .lines()
        .any(|line| line.starts_with(&format!("{toolchain}-")))
    {
        return Ok(());
    }
    let line = format!("rustup toolchain install {toolchain} --profile minimal --no-self-update");
    install(&context.command(&line))
}

/// Installs a component of a toolchain, of the one in use if none is named, unless it is there.
pub(crate) fn need_component(
    context: &Context,
    toolchain: Option<&str>,
    component: &str,
) -> Result<()> {
    let mut of = String::new();
    if let Some(toolchain) = toolchain {
        need_toolchain(context, toolchain)?;
        of = format!("--toolchain {toolchain}");
    }
    let installed = context
        .command(&format!("rustup component list --installed {of}"))
        .read()?;
    if installed.lines().any(|line| line.starts_with(component)) {
        return Ok(());
    }
    install(&context.command(&format!("rustup component add {of} {component}")))
}

/// Installs a sub-command of cargo that is published as a crate of its name, such as `cargo-hack`, unless
/// it is there.
pub(crate) fn need_cargo_tool(context: &Context, tool: &str) -> Result<()> {
    if on_path(tool).is_some() {
        return Ok(());
    }
    // Unoptimized: that saves minutes, and what a tool does takes seconds either way.
    let line = format!("cargo install --locked --debug {tool}");
    install(&context.command(&line).env("CARGO_PROFILE_DEV_DEBUG", "0"))?;
    present(tool, tool)
}

/// Installs the Debian package that brings a program, unless the program is there.
pub(crate) fn need_debian(context: &Context, package: &str, program: &str) -> Result<()> {
    if on_path(program).is_some() {
        return Ok(());
    }
    debian(context, package)?;
    present(program, package)
}

/// Installs an emulator, such as `qemu-system-arm`, unless it is there.
pub(crate) fn need_qemu(context: &Context, program: &str) -> Result<()> {
    let package = match program {
        "qemu-system-riscv64" => "qemu-system-misc",
        other => other,
    };
    need_debian(context, package, program).or_else(|problem| {
        // A newer qemu-utils, from a distribution's backports, keeps the package out.
        eprintln!("{problem}; trying again without qemu-utils");
        need_debian(context, &format!("{package} qemu-utils-"), program)
    })
}

/// Installs Debian packages.
fn debian(context: &Context, packages: &str) -> Result<()> {
    let sudo = if is_root() {
        ""
    } else {
        "sudo --non-interactive "
    };
    // Old lists may still do; if they do not, the installation says what is missing.
    if let Err(problem) = context.command(&format!("{sudo}apt-get update")).run() {
        eprintln!("{problem}");
    }
    let apt_get = format!(
        "{sudo}env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y --no-install-recommends {packages}"
    );
    install(&context.command(&apt_get))
}

/// Makes a Python environment with these packages, in a directory relative to the root; returns the path of
/// its program.
pub(crate) fn need_python(context: &Context, dir: &str, packages: &str) -> Result<String> {
    need_debian(context, "python3", "python3")?;
    let python = format!("{dir}/bin/python");
    let pip = context.command(&format!("{python} -m pip --version"));
    if !context.root.join(&python).is_file() || pip.read().is_err() {
        let venv = context.command(&format!("python3 -m venv --clear {dir}"));
        if let Err(problem) = venv.run() {
            // Debian has what is missing in a package of its own.
            eprintln!("{problem}; installing the package python3-venv, then trying again");
            debian(context, "python3-venv")?;
            install(&venv)?;
        }
    }
    // Packages that are there already are not asked for over the network.
    let line = format!("{python} -m pip install --quiet --disable-pip-version-check {packages}");
    install(&context.command(&line))?;
    Ok(python)
}

fn install(line: &Line) -> Result<()> {
    line.run()
        .map_err(|problem| format!("{problem}; run it by hand: {line}").into())
}

fn present(program: &str, package: &str) -> Result<()> {
    match on_path(program) {
        Some(_) => Ok(()),
        None => Err(format!("{package} is installed, but {program} is not on the PATH").into()),
    }
}

fn on_path(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|dir| dir.join(program))
        .find(|file| file.is_file())
}

pub(crate) fn is_root() -> bool {
    std::fs::metadata("/proc/self").is_ok_and(|process| process.uid() == 0)
}
