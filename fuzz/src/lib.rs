//! What the fuzz targets share. Each is a file of `src/bin`, with seeds in `seeds/NAME`.

use std::fs;
use std::path::Path;

mod progress;

pub use progress::report;

/// Makes a target of a function of bytes: `cargo fuzz` runs it; as a test, or as a program by itself, it gets its seeds.
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

/// Gives a target each of its seeds. A finding of the fuzzer becomes one.
///
/// # Panics
/// If the target does, or has no seed.
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
        // Shown if the target panics.
        println!("{}", file.display());
        run(&fs::read(&file).unwrap());
    }
}
