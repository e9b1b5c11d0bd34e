//! The seeds of a target: each line of `fuzz/seeds/TARGET.txt` is a seed in hexadecimal, or `-` for the empty seed, or a
//! comment that begins with `#`.

use std::fs;
use std::path::Path;

use data_encoding::HEXLOWER;

/// A seed, and the number of its line.
type Seed = (usize, Vec<u8>);

/// Runs a target with each of its seeds.
///
/// # Panics
/// Panics if the target panics, or if its seeds cannot be read.
pub fn replay<R>(target: &str, run: fn(&[u8]) -> R) {
    for (line, seed) in read(target) {
        // The line is shown if the target panics.
        println!("{}:{line}", file(target));
        run(&seed);
    }
}

/// Writes each seed of a target to a file of `fuzz/target/seeds/TARGET`, since libFuzzer reads a folder of inputs.
///
/// # Panics
/// Panics if the seeds cannot be read, or the files cannot be written.
pub fn unpack(target: &str) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("target/seeds")
        .join(target);
    let failed = |error| panic!("{}: {error}", folder.display());
    fs::create_dir_all(&folder).unwrap_or_else(failed);
    for (line, seed) in read(target) {
        fs::write(folder.join(line.to_string()), seed).unwrap_or_else(failed);
    }
}

fn file(target: &str) -> String {
    format!("fuzz/seeds/{target}.txt")
}

fn read(target: &str) -> Vec<Seed> {
    let file = file(target);
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(&file))
        .unwrap_or_else(|error| panic!("{file}: {error}; write at least one seed to this file"));
    parse(&file, &text).unwrap_or_else(|fault| panic!("{fault}"))
}

fn parse(file: &str, text: &str) -> Result<Vec<Seed>, String> {
    let lines = text.lines().zip(1..);
    let seeds = lines.filter(|(line, _)| !line.starts_with('#'));
    let seeds = seeds.map(|(line, number)| {
        let bytes = match line {
            "" => Err("the line is empty".to_owned()),
            "-" => Ok(Vec::new()),
            _ => HEXLOWER
                .decode(line.as_bytes())
                .map_err(|error| error.to_string()),
        };
        let remedy =
            "write two digits of 0-9 and a-f for each byte of a seed, or `-` for an empty seed";
        let bytes = bytes.map_err(|fault| format!("{file}:{number}: {fault}; {remedy}"))?;
        Ok((number, bytes))
    });
    let seeds: Vec<_> = seeds.collect::<Result<_, String>>()?;
    if seeds.is_empty() {
        return Err(format!("{file} has no seed; write one a line, such as `-`"));
    }
    Ok(seeds)
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn a_line_is_a_seed() {
        let seeds = parse("it.txt", "# One\n00ff\n# Nothing\n-\n").unwrap();
        assert_eq!(seeds, [(2, vec![0, 0xff]), (4, vec![])]);
    }

    #[test]
    fn a_malformed_line_is_refused() {
        for line in ["", "0", "0g", "0F", "00 ff", "--"] {
            let fault = parse("it.txt", &format!("00\n{line}\n")).unwrap_err();
            assert!(fault.starts_with("it.txt:2: "), "{fault}");
            assert!(fault.contains("; write two digits"), "{fault}");
        }
        assert!(parse("it.txt", "# One\n").is_err());
    }
}
