//! Has the linker make an image that can lie anywhere.

fn main() {
    // All memory of a hart can be written, so that relocations may be anywhere.
    for argument in [
        "-pie",
        "--no-dynamic-linker",
        "-znotext",
        "--emit-relocs",
        "-Tprogram.x",
    ] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
