use crate::Result;
use crate::command::{Line, side_by_side};
use crate::context::Context;
use crate::parts::Summary;
use crate::sources;
use crate::tools::{need_cargo_tool, need_debian, need_toolchain};

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_toolchain(context, "nightly")?;
    need_cargo_tool(context, "cargo-fuzz")?;
    need_debian(context, "g++", "c++")?;
    let files = sources::below(&context.root.join("fuzz/src/bin"), &|_| false)?;
    let names = files.iter().filter_map(|file| file.file_stem());
    let targets: Vec<_> = names
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    if targets.is_empty() {
        return Err("fuzz/src/bin has no target".into());
    }
    let seconds = context.options.fuzz_seconds;
    context
        .command("cargo +nightly fuzz build --fuzz-dir fuzz")
        .run()?;
    let mut runs = Vec::new();
    for target in &targets {
        // libFuzzer adds to the first directory and only reads the second, to which the target writes its seeds.
        std::fs::create_dir_all(context.root.join("fuzz/corpus").join(target))?;
        let inputs = format!("fuzz/corpus/{target} fuzz/target/seeds/{target}");
        let line = format!(
            "cargo +nightly fuzz run --fuzz-dir fuzz {target} {inputs} -- \
             -max_total_time={seconds} -timeout=10 -verbosity=0 -print_final_stats=1"
        );
        runs.push(context.command(&line));
    }
    side_by_side(&runs, Line::collect)?;
    Ok(Summary::of(format!(
        "{} targets, {seconds} s each",
        targets.len()
    )))
}
