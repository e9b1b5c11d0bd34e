//! The experiment as a process: its samples are in the file, in each run the same, and in a recording.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// The time that a system may take to come up, on a machine that has much else to do.
const PATIENCE: Duration = Duration::from_secs(120);
const LOOK: Duration = Duration::from_millis(10);
const LINES: usize = 120;

fn condor(place: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_experiment"));
    command.args(arguments).current_dir(place);
    command.env("XDG_RUNTIME_DIR", place).stdin(Stdio::null());
    command
}

fn text(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// The description and its files, at a place of its own.
fn copied() -> tempfile::TempDir {
    let (package, place) = (
        Path::new(env!("CARGO_MANIFEST_DIR")),
        tempfile::tempdir().unwrap(),
    );
    fs::create_dir(place.path().join("files")).unwrap();
    for file in ["condor.toml", "files/stimulus"] {
        fs::copy(package.join(file), place.path().join(file)).unwrap();
    }
    place
}

/// The samples: the duty in percent, and the angle in steps.
fn samples(place: &Path) -> Vec<[i32; 2]> {
    let bytes = fs::read(place.join("files/response")).unwrap();
    let words: Vec<_> = bytes
        .chunks_exact(4)
        .map(|word| i32::from_le_bytes(word.try_into().unwrap()))
        .collect();
    words.chunks_exact(2).map(|it| [it[0], it[1]]).collect()
}

#[test]
fn each_run_has_the_same_samples_of_the_stimulus_in_the_file() {
    let run = || {
        let place = copied();
        let up = ["up", "--headless", "--for", "2s", "--speed", "max"];
        let output = condor(place.path(), &up).output().unwrap();
        let text = text(&output);
        assert!(text.contains("8000 bytes are in `response`"), "{text}");
        samples(place.path())
    };
    let samples = run();
    let duties: Vec<_> = samples.iter().map(|[duty, _]| *duty).collect();
    let stimulus = [[0; 100].as_slice(), &[30; 400], &[-30; 300], &[0; 200]].concat();
    assert_eq!(duties, stimulus);
    // The motor rests in the middle of its turn, and then turns.
    assert!(samples[..100].iter().all(|[_, angle]| *angle == 2048));
    assert!(samples[499][1] != samples[110][1]);
    assert_eq!(samples, run());
}

#[test]
fn a_recording_has_the_response() {
    struct Up(Child);
    impl Drop for Up {
        fn drop(&mut self) {
            // One that has ended is not there any more.
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }
    let place = copied();
    let description = place.path().join("condor.toml");
    let quiet = fs::read_to_string(&description).unwrap();
    fs::write(&description, quiet.replace("headless", "# headless")).unwrap();
    let up = condor(place.path(), &["up", "--headless", "--for", "10m"])
        .stdout(Stdio::null())
        .spawn();
    let up = Up(up.unwrap());
    let begun = Instant::now();
    let mut recorder = loop {
        let mut recorder = condor(place.path(), &["record", "run.mcap"]);
        let mut recorder = recorder.stdout(Stdio::null()).spawn().unwrap();
        // The file is there when the recording has begun.
        while !place.path().join("run.mcap").exists() && recorder.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < PATIENCE);
            thread::sleep(LOOK);
        }
        if recorder.try_wait().unwrap().is_none() {
            break Up(recorder);
        }
        assert!(begun.elapsed() < PATIENCE);
    };
    let mut typed = condor(place.path(), &["tty", "motor"]);
    let typed = typed.stdin(Stdio::piped()).stdout(Stdio::null()).spawn();
    let mut typed = Up(typed.unwrap());
    typed.0.stdin.take().unwrap().write_all(b"go\n").unwrap();
    while !place.path().join("files/response").exists() {
        assert!(begun.elapsed() < PATIENCE);
        thread::sleep(LOOK);
    }
    let pid = recorder.0.id().to_string();
    let interrupted = Command::new("kill").args(["-INT", &pid]).status();
    assert!(interrupted.unwrap().success());
    assert!(recorder.0.wait().unwrap().success());
    let export = ["export", "run.mcap", "--csv", "run.csv"];
    let exported = condor(place.path(), &export).output().unwrap();
    assert!(exported.status.success(), "{}", text(&exported));
    let table = fs::read_to_string(place.path().join("run.csv")).unwrap();
    assert!(table.lines().any(|line| line.contains(",30,")), "{table}");
    drop(up);
}

#[test]
fn it_is_short() {
    let texts = [
        include_str!("../src/lib.rs"),
        include_str!("../src/main.rs"),
        include_str!("../hart/src/main.rs"),
    ];
    let lines = texts.iter().flat_map(|text| text.lines().map(str::trim));
    let lines = lines.filter(|line| !line.is_empty() && !line.starts_with("//"));
    let count = lines.count();
    assert!(count <= LINES, "{count} lines");
}
