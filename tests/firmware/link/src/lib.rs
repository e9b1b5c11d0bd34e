//! The linking of firmwares, for their build scripts.

/// Has the linker make an image of a package's programs by `link.x` of riscv-rt or cortex-m-rt.
pub fn firmware() {
    for argument in [
        "-Tlink.x",
        "--nmagic",
        // The search for panicking paths follows them; the target does not load them.
        "--emit-relocs",
    ] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
