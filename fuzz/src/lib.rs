//! Code that the fuzz targets share. Each target is a file of `src/bin`, with seeds in `seeds/NAME`.

use std::fs;
use std::path::Path;

mod progress;

pub use progress::report;

/// Makes a target of a function of bytes. `cargo fuzz` runs the target; as a test, or as a program by itself,
/// it runs each of its seeds.
#[macro_export]
macro_rules! target {
    ($run:expr) => {
        #[cfg(fuzzing)]
        libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
            let run: fn(&[u8]) -> _ = $run;
            run(bytes);
        });

        #[cfg(not(fuzzing))]
        fn main() {
            $crate::replay(env!("CARGO_BIN_NAME"), $run);
        }

        #[test]
        fn seeds() {
            main();
        }
    };
}

/// Runs a target with each of its seeds. An input with which the fuzzer found a fault becomes a seed.
///
/// # Panics
/// Panics if the target panics, or has no seed.
pub fn replay<R>(target: &str, run: fn(&[u8]) -> R) {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("seeds")
        .join(target);
    let mut files: Vec<_> = fs::read_dir(&seeds)
        .unwrap_or_else(|error| panic!("{}: {error}", seeds.display()))
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    assert!(!files.is_empty(), "{} has no seed", seeds.display());
    for file in files {
        // The name is shown if the target panics.
        println!("{}", file.display());
        run(&fs::read(&file).unwrap());
    }
}
