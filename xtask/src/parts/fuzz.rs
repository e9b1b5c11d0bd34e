use std::path::Path;

use crate::Result;
use crate::command::together;
use crate::context::Context;
use crate::parts::Summary;
use crate::tools::{need_cargo_tool, need_debian, need_toolchain};

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_toolchain(context, "nightly")?;
    need_cargo_tool(context, "cargo-fuzz")?;
    need_debian(context, "g++", "c++")?;
    let targets = sources(&context.root.join("fuzz/src/bin"))?;
    if targets.is_empty() {
        return Err("fuzz/src/bin has no target".into());
    }
    let seconds = context.fuzz_seconds;
    context
        .command("cargo +nightly fuzz build --fuzz-dir fuzz")
        .run()?;
    let mut runs = Vec::new();
    for target in &targets {
        // libFuzzer adds to the first directory and only reads the second.
        std::fs::create_dir_all(context.root.join("fuzz/corpus").join(target))?;
        let mut inputs = format!("fuzz/corpus/{target}");
        if context.root.join("fuzz/seeds").join(target).is_dir() {
            inputs = format!("{inputs} fuzz/seeds/{target}");
        }
        let line = format!(
            "cargo +nightly fuzz run --fuzz-dir fuzz {target} {inputs} -- \
             -max_total_time={seconds} -timeout=10 -verbosity=0 -print_final_stats=1"
        );
        runs.push(context.command(&line));
    }
    together(&runs)?;
    Ok(Summary::of(format!(
        "{} targets, {seconds} s each",
        targets.len()
    )))
}

/// Returns the names of the Rust files in a directory, without their extension.
fn sources(dir: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(dir)? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "rs")
            && let Some(name) = path.file_stem()
        {
            names.push(name.to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}
