//! Tells the linker where the chip's memory is, and which interrupts there are.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let variable = |name| std::env::var(name).unwrap_or_default();
    println!("cargo::rustc-check-cfg=cfg(microbit)");
    let board = if variable("TARGET").starts_with("thumbv6m") {
        println!("cargo::rustc-cfg=microbit");
        "microbit.x"
    } else {
        "mps2-an385.x"
    };
    let from = PathBuf::from(variable("CARGO_MANIFEST_DIR")).join(board);
    let to = PathBuf::from(variable("OUT_DIR"));
    std::fs::copy(&from, to.join("memory.x"))?;
    std::fs::write(
        to.join("device.x"),
        "/* Where cortex-m-rt looks for the interrupts that a program does not use: there are none. */\n",
    )?;
    println!("cargo::rerun-if-changed={}", from.display());
    println!("cargo::rustc-link-search={}", to.display());
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // The search for panicking paths follows them; the target does not load them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
    Ok(())
}
