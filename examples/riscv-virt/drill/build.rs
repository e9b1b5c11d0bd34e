//! Has the linker make an image that can lie anywhere.

fn main() {
    let dir = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default();
    println!("cargo::rerun-if-changed=../program.x");
    // All memory of a hart can be written, so that relocations may be anywhere.
    for argument in ["-pie", "--no-dynamic-linker", "-znotext", "--emit-relocs"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
    println!("cargo::rustc-link-arg-bins=-T{dir}/../program.x");
}
