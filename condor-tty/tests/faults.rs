//! A short run of the example `terminal_faults`, which starts itself again as its own children.

#[path = "../examples/terminal_faults/main.rs"]
mod faults;

fn main() -> std::process::ExitCode {
    faults::main()
}
