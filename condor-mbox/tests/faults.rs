//! A short run of the example `mailbox_faults`, which starts itself again as its own children.

#[path = "../examples/mailbox_faults/main.rs"]
mod faults;

fn main() -> std::process::ExitCode {
    faults::main()
}
