//! The header of every output: where, from what and with what the figures were made.

use std::fs;
use std::process::Command;

/// Returns the machine, the kernel, the commit and the compiler, a line each.
pub(crate) fn describe() -> String {
    let uname = rustix::system::uname();
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = cpuinfo.lines().find(|line| line.starts_with(name))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    };
    let model = field("model name")
        .or_else(|| field("CPU part"))
        .unwrap_or_default();
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let host = if field("flags").is_some_and(|flags| flags.contains("hypervisor")) {
        ", virtual machine"
    } else {
        ""
    };
    format!(
        "machine: {model}, {cores} cores, {}{host}\nkernel:  {} {}\ncommit:  {}\nrustc:   {}\n",
        uname.machine().to_string_lossy(),
        uname.sysname().to_string_lossy(),
        uname.release().to_string_lossy(),
        commit().unwrap_or_else(|| "unknown".to_owned()),
        env!("CONDOR_BENCH_RUSTC"),
    )
}

/// Returns the commit of the source, and whether it was changed since.
fn commit() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output = Command::new("git")
            .args(["-C", env!("CARGO_MANIFEST_DIR")])
            .args(arguments)
            .output()
            .ok()?;
        output
            .status
            .success()
            .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let hash = git(&["rev-parse", "--short=12", "HEAD"])?;
    let changed = git(&["status", "--porcelain", "--untracked-files=no"])?;
    Some(if changed.is_empty() {
        hash
    } else {
        format!("{hash} with changes")
    })
}
