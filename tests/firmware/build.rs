//! Tells the linker where the machine's memory is.

fn main() {
    link::firmware();
    let variable = |name| std::env::var(name).unwrap_or_default();
    let machine = match variable("CARGO_CFG_TARGET_ARCH").as_str() {
        "riscv64" => "virt",
        _ if variable("TARGET").starts_with("thumbv6m") => "microbit",
        _ => "mps2",
    };
    let memory = variable("CARGO_MANIFEST_DIR") + "/memory";
    println!("cargo::rerun-if-changed={memory}");
    println!("cargo::rustc-link-search={memory}/{machine}");
    println!("cargo::rustc-check-cfg=cfg(microbit)");
    if machine == "microbit" {
        println!("cargo::rustc-cfg=microbit");
    }
}
