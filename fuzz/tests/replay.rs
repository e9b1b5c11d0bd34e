//! Every seed of every target, on a stable compiler. A finding of the fuzzer becomes a seed.

use std::fs;
use std::path::Path;

/// Gives a target each of its seeds.
fn replay(target: &str, run: fn(&[u8])) {
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

macro_rules! targets {
    ($($target:ident,)*) => {
        $(
            #[test]
            fn $target() {
                replay(stringify!($target), condor_fuzz::$target);
            }
        )*

        #[test]
        fn every_target_is_here() {
            let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz_targets");
            let mut files: Vec<_> = fs::read_dir(directory)
                .unwrap()
                .map(|entry| entry.unwrap().path().file_stem().unwrap().to_owned())
                .collect();
            files.sort();
            assert_eq!(files, [$(stringify!($target)),*]);
        }
    };
}

targets! {
    debug_gateway,
    debug_stub,
    drivers,
    fs_client,
    fs_host,
    hand_config,
    hand_control,
    hostile_mailbox,
    live_connection,
    live_session,
    mcap_reader,
    regions,
    remote_request,
    tty_editor,
    tty_host,
    tty_processor,
    vars,
    window_bounds,
}
