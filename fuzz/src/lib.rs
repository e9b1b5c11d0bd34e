//! Code that the fuzz targets share. Each target is a file of `src/bin`, with seeds in `seeds/NAME.txt`.

mod progress;
mod seeds;

pub use progress::report;
pub use seeds::{replay, unpack};

/// Makes a target of a function of bytes. Under `cargo fuzz`, the target writes its seeds to files and runs what the
/// fuzzer finds; as a test, or as a program by itself, it runs each of its seeds.
#[macro_export]
macro_rules! target {
    ($run:expr) => {
        #[cfg(fuzzing)]
        libfuzzer_sys::fuzz_target!(
            init: $crate::unpack(env!("CARGO_BIN_NAME")),
            |bytes: &[u8]| {
                let run: fn(&[u8]) -> _ = $run;
                run(bytes);
            }
        );

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
