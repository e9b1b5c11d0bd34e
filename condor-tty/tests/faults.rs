//! A short run of the example `faults`, which starts itself again as its own children.

#[path = "../examples/faults/main.rs"]
mod faults;

fn main() -> std::process::ExitCode {
    faults::main()
}
