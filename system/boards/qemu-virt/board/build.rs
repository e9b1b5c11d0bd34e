//! Has the linker find `program.x`.

fn main() {
    let dir = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo::rerun-if-changed=program.x");
    println!("cargo::rustc-link-search={dir}");
}
