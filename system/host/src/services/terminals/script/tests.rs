use super::*;
use crate::services::terminals::{begin, log};

fn directory() -> (tempfile::TempDir, SystemDirectory) {
    let place = tempfile::tempdir().expect("a directory");
    let directory = SystemDirectory::at(place.path().into());
    std::fs::create_dir(directory.terminals()).expect("a directory");
    (place, directory)
}

fn written(directory: &SystemDirectory) -> String {
    std::fs::read_to_string(directory.typing()).expect("a record")
}

fn type_all(writer: &ScriptWriter, now: u64, name: &str, from: u64, characters: &[u8]) {
    for (place, character) in (from..).zip(characters) {
        writer.begin(Turn::Any, now);
        assert!(writer.sends(name, place, *character).expect("room"));
    }
}

const RECORD: &str = "condor typing 1\n0 a 0 run\\r\n0 a 4 \\xc3\\xa9\\\\\n7 b 0  x\\x03";

#[test]
fn a_record_has_a_line_for_what_was_typed_together() {
    let (_place, directory) = directory();
    begin(&directory, None).expect("room");
    let writer = ScriptWriter::open(&directory).expect("a record");
    type_all(&writer, 0, "a", 0, b"run\r");
    type_all(&writer, 0, "a", 4, "é\\".as_bytes());
    type_all(&writer, 7, "b", 0, b" x\x03");
    assert_eq!(written(&directory), RECORD);
    let script = Script::read(&directory.typing(), &["a", "b"]).expect("a script");
    assert_eq!(script.text, RECORD);
}

#[test]
fn without_the_turn_nothing_is_typed_and_again_what_was_recorded() {
    let (_place, directory) = directory();
    begin(&directory, None).expect("room");
    let writer = ScriptWriter::open(&directory).expect("a record");
    type_all(&writer, 5, "a", 0, b"x");
    writer.begin(Turn::None, 6);
    assert!(!writer.sends("a", 1, b'y').expect("room"));
    // A service that comes after it sends what may not have been sent, and records it no more.
    let writer = ScriptWriter::open(&directory).expect("a record");
    writer.begin(Turn::Recorded, 5);
    assert!(!writer.sends("a", 1, b'y').expect("room"));
    assert!(writer.sends("a", 0, b'x').expect("room"));
    assert!(!writer.sends("b", 0, b'x').expect("room"));
    type_all(&writer, 5, "a", 0, b"xy");
    assert_eq!(written(&directory), "condor typing 1\n5 a 0 x\n5 a 1 y");
}

#[test]
fn what_was_cut_anywhere_is_not_recorded() {
    let (_place, directory) = directory();
    let whole = "condor typing 1\n12 a 0 ru\\r\n12 b 34 \\x03";
    for length in "condor typing 1".len()..=whole.len() {
        std::fs::write(directory.typing(), &whole[..length]).expect("room");
        let writer = ScriptWriter::open(&directory).expect("a record");
        let left = written(&directory);
        assert!(whole.starts_with(&left), "{left}");
        let count = |name: &str| writer.recorded_of(name);
        // Each is there as a whole or not at all.
        let expected = match length {
            ..24 => (0, 0),
            24 => (1, 0),
            25 | 26 => (2, 0),
            27..40 => (3, 0),
            _ => (3, 35),
        };
        assert_eq!((count("a"), count("b")), expected, "{:?}", &whole[..length]);
        let after = Script::read(&directory.typing(), &["a", "b"]);
        after.expect("what is left is whole");
    }
}

#[test]
fn a_script_is_typed_at_its_instants_and_in_its_order() {
    let (_place, directory) = directory();
    std::fs::write(directory.replay(), RECORD).expect("room");
    let script = Script {
        text: RECORD.into(),
    };
    begin(&directory, Some(&script)).expect("room");
    let typed = |name| {
        let log = log(&directory.terminals(), name);
        std::fs::read(log.with_extension("typed")).expect("it is typed")
    };
    assert_eq!(
        (typed("a"), typed("b")),
        ("run\ré\\".into(), b" x\x03".into())
    );
    let mut writer = ScriptWriter::open(&directory).expect("a record");
    let mut count = 0;
    while let Some(at) = writer.next_instant() {
        let name = if count < 7 { "a" } else { "b" };
        let (place, other) = if count < 7 {
            (count, "b")
        } else {
            (count - 7, "a")
        };
        assert_eq!(at, if count < 7 { 0 } else { 7 });
        writer.begin(Turn::None, at);
        assert_eq!(writer.readable(name, place, 9), 0, "without the turn");
        writer.begin(Turn::Any, at);
        if at > 0 {
            writer.begin(Turn::Any, at - 1);
            assert_eq!(writer.readable(name, place, 9), 0, "too early");
            writer.begin(Turn::Any, at);
        }
        let place_of_other = writer.recorded_of(other);
        assert_eq!(writer.readable(other, place_of_other, 9), 0);
        assert_eq!(writer.readable(name, place, 9), 1);
        let character = typed(name)[usize::try_from(place).expect("a place")];
        assert!(writer.sends(name, place, character).expect("room"));
        count += 1;
        // Whichever service goes on.
        writer = ScriptWriter::open(&directory).expect("a record");
    }
    assert_eq!(count, 10);
    let text = written(&directory).replace('\n', " ");
    assert!(text.ends_with("7 b 0   7 b 1 x 7 b 2 \\x03"), "{text}");
    writer.begin(Turn::None, 7);
    assert_eq!(writer.readable("a", 7, 9), 9, "then people type");
}

#[test]
fn every_mistake_of_a_record_is_told_with_its_line() {
    let (_place, directory) = directory();
    let path = directory.typing();
    let told = |text: &str| {
        std::fs::write(&path, text).expect("room");
        let error = Script::read(&path, &["a", "b"]).expect_err("a mistake");
        let name = format!("{}:", path.display());
        error.to_string().replace(&name, "")
    };
    assert_eq!(
        told("condor typing 2\n"),
        "1: this is no record of typing: it does not begin with the line `condor typing 1`"
    );
    let text =
        "condor typing 1\n9 a 0 x\n8 a 1 x\n9 c 0 x\n\n9 a 1 \n9 a 1 \\q\n9 a b c\n9 a 1 \\\\";
    let wrong = told(text);
    let lines: Vec<_> = wrong.lines().collect();
    assert_eq!(
        lines[..2],
        [
            "3: the instant 8 is before that of the line above, 9",
            "4: there is no processor `c`; there are a, b"
        ]
    );
    for (line, begin) in lines[2..].iter().zip(["6: ", "7: ", "8: "]) {
        assert!(
            line.starts_with(&format!("{begin}expected an instant in ns")),
            "{line}"
        );
    }
    assert_eq!(lines.len(), 5, "{wrong}");
}
