//! Tells the linker where the machine's memory is.

fn main() {
    let dir = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo::rerun-if-changed=link.x");
    println!("cargo::rustc-link-arg-bins=-T{dir}/link.x");
    // The search for panicking paths follows them; the target does not load them.
    println!("cargo::rustc-link-arg-bins=--emit-relocs");
}
