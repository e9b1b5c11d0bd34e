//! The examples that end by themselves, run as a reader would run them.
#![cfg(feature = "async")]

use std::path::PathBuf;
use std::process::Command;

/// The program of an example: where cargo puts it beside the tests, which it builds first if this
/// test was built alone.
fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let path = test.ancestors().nth(2).unwrap().join("examples").join(name);
    if !path.exists() {
        let mut cargo = Command::new(std::env::var_os("CARGO").expect("cargo runs the tests"));
        cargo.args(["build", "--features", "linux,async", "--example", name]);
        assert!(
            cargo
                .current_dir(env!("CARGO_MANIFEST_DIR"))
                .status()
                .unwrap()
                .success()
        );
    }
    path
}

fn run(name: &str) -> String {
    let output = Command::new(program(name)).output().unwrap();
    assert!(output.status.success(), "{name}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn replies_are_awaited_in_tokio() {
    let said = run("await_tokio");
    assert!(said.contains("10000 requests"), "{said}");
}

#[test]
fn replies_are_awaited_in_embassy() {
    let said = run("await_embassy");
    assert!(said.contains("1000 requests"), "{said}");
}

#[test]
fn a_location_is_read_by_message() {
    let said = run("simple_reference");
    assert!(
        said.contains("location 100 of processor 0 holds 1988"),
        "{said}"
    );
}
