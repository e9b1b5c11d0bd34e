//! Bad texts, each with the rule that finds it, and good ones next to them.

use super::rules::{Exception, Rules};
use super::{Findings, apply_exceptions, check, source};

/// A source, and the rule that refuses a text of it.
const BAD: [(&str, &str); 20] = [
    ("/// The number of frames.\npub fn frames() {}", "verb"),
    (
        "pub trait T {\n/// Next frame of the ring.\nfn next(&self);\n}",
        "verb",
    ),
    (
        "pub struct S;\nimpl S {\n/// A new ring of frames.\npub fn new() -> S { S }\n}",
        "verb",
    ),
    (
        "/// Sends it.\n///\n/// # Errors\n/// The bus's.\npub fn send() {}",
        "errors",
    ),
    (
        "/// Sends it.\n///\n/// # Errors\n/// As [`read`].\npub fn send() {}",
        "errors",
    ),
    (
        "/// Sends it.\n///\n/// # Errors\n/// The memory is gone.\npub fn send() {}",
        "errors",
    ),
    (
        "/// What the controller sees in a tick.\npub struct Input;",
        "opening",
    ),
    (
        "/// Whose turn comes next.\npub const TURN: u8 = 0;",
        "opening",
    ),
    ("/// How many joints move.\nstruct Hidden;", "opening"),
    ("// Who sleeps is woken by the flag.\nfn f() {}", "opening"),
    (
        "#[derive(Parser)]\npub struct A {\n/// Where the recording goes\n#[arg(long)]\nto: u8,\n}",
        "opening",
    ),
    (
        "/// The file that is kept in the place\n/// of the log of before.\npub struct Log;",
        "riddle",
    ),
    (
        "/// A frame that is to be sent in the next tick.\npub struct Frame;",
        "riddle",
    ),
    (
        "#[derive(Debug, Error)]\npub enum E {\n#[error(\"the word is no mode\")]\nMode,\n}",
        "riddle",
    ),
    (
        "fn f() { eprintln!(\"the reader, who is asleep, missed {n} frames\"); }",
        "riddle",
    ),
    (
        "/// The time-out of a request, in ms.\npub const MS: u8 = 0;",
        "term",
    ),
    ("/// A counter.\npub struct Counter;", "echo"),
    ("/// States of a slot.\npub enum SlotState {}", "echo"),
    ("/// All of them.\npub const FLAGS: u8 = 0;", "pronoun"),
    ("/// The bus's.\npub const ADDRESS: u8 = 0;", "pronoun"),
];

/// Texts like the bad ones that no rule refuses.
const GOOD: [&str; 10] = [
    "/// Returns the number of frames.\npub fn frames() {}",
    "/// Atomically swaps the two frames.\npub fn swap() {}",
    "/// Sends it.\n///\n/// # Errors\n/// Returns [`Error::Full`] if the ring is full.\npub fn send() {}",
    "/// Sends it.\n///\n/// # Errors\n/// [`AccessError`] if the memory cannot be accessed.\npub fn send() {}",
    "/// The sensor readings of a tick.\npub struct Input;",
    "/// A counter of missed ticks, which wraps.\npub struct Counter;",
    "/// The file that there is no room for lives in the old place.\npub struct Log;",
    "/// The code of `what is no mode`, see [the code](slave).\npub struct Frame;",
    "fn f() { let s = \"// What is no comment\"; }",
    "#[cfg(test)]\nmod tests {\n/// What a test needs.\npub fn what() {}\n// Who is it?\n}",
];

fn rules() -> Rules {
    Rules::parse(include_str!("../../../words.toml")).unwrap()
}

fn refused(rules: &Rules, text: &str) -> Vec<String> {
    let texts = source::read(text).unwrap();
    let found = check(rules, "src/lib.rs", &texts);
    found.into_iter().map(|finding| finding.rule).collect()
}

#[test]
fn each_bad_text_is_found_by_its_rule() {
    let rules = rules();
    let missed = BAD
        .iter()
        .filter(|(text, rule)| !refused(&rules, text).iter().any(|it| it == rule));
    let missed: Vec<_> = missed.collect();
    assert!(missed.is_empty(), "{} of 20: {missed:#?}", missed.len());
}

#[test]
fn no_good_text_is_refused() {
    let rules = rules();
    for text in GOOD {
        assert_eq!(refused(&rules, text), Vec::<String>::new(), "{text}");
    }
}

#[test]
fn a_finding_names_the_line_on_which_it_stands() {
    let source = "fn f() {}\n\n/// A frame.\n///\n/// Its sender,\n/// who is asleep.\npub struct Ring;\n\nfn g() {\n    // ü\n    f(); // What it does.\n}\n";
    let texts = source::read(source).unwrap();
    let found = check(&rules(), "src/lib.rs", &texts);
    let lines: Vec<_> = found.iter().map(|it| (it.line, it.rule.as_str())).collect();
    assert_eq!(lines, [(6, "riddle"), (11, "opening")], "{found:#?}");
}

#[test]
fn an_exception_takes_one_finding_and_is_refused_if_it_takes_none() {
    let rules = rules();
    let texts = source::read("/// What it is.\nstruct A;\n/// What it does.\nstruct B;").unwrap();
    let mut found: Findings = [("a.rs".to_owned(), check(&rules, "a.rs", &texts))].into();
    let exception = |text: &str| Exception {
        path: "a.rs".to_owned(),
        rule: "opening".to_owned(),
        text: text.to_owned(),
        reason: "a test".to_owned(),
    };
    let exceptions = [exception("it is"), exception("it was")];
    let unused = apply_exceptions(&exceptions, &mut found);
    assert_eq!(unused.len(), 1);
    assert_eq!(unused[0].text, "it was");
    assert_eq!(found["a.rs"].len(), 1);
}
