//! For the build scripts of programs of harts.

/// Prints the linker arguments that make the programs of a package images for harts, which can lie
/// anywhere in a hart's memory. Call it from the package's build script.
pub fn link() {
    // All memory of a hart can be written, so that relocations may be anywhere.
    for argument in [
        "-pie",
        "--no-dynamic-linker",
        "-znotext",
        "--emit-relocs",
        "-Tprogram.x",
        // Debuggers must not take what was dropped for what lies at address 0, where images begin.
        "-zdead-reloc-in-nonalloc=.debug_*=0xffffffffffffffff",
    ] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
