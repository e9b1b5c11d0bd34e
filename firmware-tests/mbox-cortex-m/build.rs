//! Tells the linker where the chip's memory is.

fn main() {
    let dir = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo::rerun-if-changed=memory.x");
    println!("cargo::rustc-link-search={dir}");
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // The search for panicking paths follows them; the target does not load them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
