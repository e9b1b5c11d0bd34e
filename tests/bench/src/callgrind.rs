//! Counting the instructions of one function of this program.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use crate::Result;

/// The number of calls of a path: enough to fill some buffers, and to divide by what is done only once.
const CALLS: usize = 4096;

/// The argument by which the program is asked to go down one path and nothing else.
pub(crate) const PATH: &str = "path";

/// Counts the instructions of calls, on average, of paths with their descriptions; returns a table of them, and
/// the counts.
///
/// # Errors
/// Returns an error if valgrind is missing or fails, or has counted nothing.
pub(crate) fn table<const N: usize>(
    head: &str,
    paths: [(&str, &str); N],
) -> Result<(String, [f64; N])> {
    let mut text = format!("{head:52} {:>12}\n", "instructions");
    let mut counts = [0.0; N];
    for (count, (name, about)) in counts.iter_mut().zip(paths) {
        *count = instructions(name)?;
        writeln!(text, "{about:52} {count:12.1}")?;
    }
    Ok((text, counts))
}

fn instructions(name: &str) -> Result<f64> {
    let directory = tempfile::tempdir()?;
    let file = directory.path().join("callgrind.out");
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no"])
        .arg(format!("--toggle-collect=condor_path_{name}"))
        .arg(format!("--callgrind-out-file={}", file.display()))
        .arg(env::current_exe()?)
        .args([PATH, name, &CALLS.to_string()])
        .output()
        .map_err(|error| {
            format!("valgrind does not run ({error}): on Debian, `apt-get install valgrind`")
        })?;
    if !output.status.success() {
        let message = String::from_utf8_lossy(&output.stderr);
        return Err(format!("callgrind of {name}: {}\n{message}", output.status).into());
    }
    let total = total(&fs::read_to_string(file)?).filter(|total| *total > 0);
    let total = total.ok_or(format!("callgrind saw nothing of {name}"))?;
    Ok(total as f64 / CALLS as f64)
}

/// Returns the number of instructions in a whole output of callgrind.
fn total(output: &str) -> Option<u64> {
    let line = |name| output.lines().find_map(|line| line.strip_prefix(name));
    line("totals:").or(line("summary:"))?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::total;

    #[test]
    fn the_total_is_found() {
        let output = "version: 1\nevents: Ir\nsummary: 81920\n\nfn=(1) main\n12 3\n";
        assert_eq!(total(output), Some(81_920));
        assert_eq!(total("version: 1\n"), None);
    }
}
