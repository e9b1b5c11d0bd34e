//! Parameters are saved, loaded and compared.

use std::process::Output;

use crate::commands::{answer, complaint, text};
use crate::joint::start;
use crate::running::Up;
use serde_json::json;

/// The file, as commands are given it.
fn file(up: &Up, name: &str) -> String {
    up.path(name).display().to_string()
}

fn code_and_text(output: &Output) -> (Option<i32>, String) {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    (output.status.code(), String::from_utf8(both).unwrap())
}

#[test]
fn what_was_saved_is_loaded_again() {
    let up = start(&[]);
    let saved = file(&up, "saved.toml");
    let told = text(&up, &["vars", "save", &saved]);
    assert_eq!(told, format!("{saved}: 8 parameters are saved\n"));
    let written = up.file("saved.toml");
    for line in [
        "[\"a:servo\"]",
        "[\"b:servo\"]",
        "\"joint.stiffness\" = 2.0 # N m/rad",
        "\"mode\" = \"idle\"",
        "\"soft\" = false",
    ] {
        assert!(written.lines().any(|it| it == line), "{line}: {written}");
    }

    text(&up, &["vars", "set", "b:joint.stiffness", "1.25"]);
    text(&up, &["vars", "set", "a:mode", "hold"]);
    let loaded = answer(&up, &["vars", "load", &saved]);
    assert_eq!(loaded["parameters"], 8);
    let changed = json!([
        {"processor": "a", "loop": "servo", "name": "mode", "before": "hold", "value": "idle"},
        {"processor": "b", "loop": "servo", "name": "joint.stiffness", "before": 1.25, "value": 2.0},
    ]);
    assert_eq!(loaded["changed"], changed);
    let told = text(&up, &["vars", "load", &saved]);
    let expected = format!("{saved}: 8 parameters, of which 0 were set\n");
    assert_eq!(told, expected);
}

#[test]
fn a_file_with_a_wrong_value_sets_nothing_and_says_what_is_allowed() {
    let up = start(&[]);
    let wrong = file(&up, "wrong.toml");
    std::fs::write(
        &wrong,
        "[\"a:servo\"]\n\
         soft = true\n\
         \"joint.stiffness\" = 60\n\
         mode = \"fault\"\n\
         \"joint.stiffnes\" = 1.0\n\
         ticks = 1\n\
         [\"c:servo\"]\n\
         soft = true\n\
         [b]\n\
         soft = []\n",
    )
    .unwrap();
    let told = complaint(&up, &["vars", "load", &wrong]);
    for (line, problem) in [
        (
            3,
            "`joint.stiffness` cannot be 60; it can be 0.0 to 50.0 N m/rad",
        ),
        (4, "`mode` cannot be fault; it can be idle, hold"),
        (5, "joint.stiffness"),
        (6, "is not a parameter and cannot be set"),
        (8, "`c:servo` is not a loop of the system with variables"),
        (10, "`b` is not a loop of the system with variables"),
    ] {
        let place = format!("wrong.toml:{line}:");
        let mut lines = told.lines();
        let found = lines.find(|it| it.contains(&place));
        let found = found.unwrap_or_else(|| panic!("nothing of line {line}: {told}"));
        assert!(found.contains(problem), "{problem}: {told}");
    }
    let get = answer(&up, &["vars", "get", "a:soft"]);
    assert_eq!(get["variables"][0]["value"], false);

    for (content, problem) in [
        ("soft = true\n", "a table is missing here"),
        ("[a:servo]\n", "wrong.toml:1:"),
        ("[\"a:servo\"]\nsoft = 1979-05-27\n", "wrong.toml:2:"),
    ] {
        std::fs::write(&wrong, content).unwrap();
        let told = complaint(&up, &["vars", "load", &wrong]);
        assert!(told.contains(problem), "{problem}: {told}");
    }
    let large = "#".repeat((4 << 20) + 1);
    std::fs::write(&wrong, large).unwrap();
    let told = complaint(&up, &["vars", "load", &wrong]);
    assert!(told.contains("has more than 4194304 bytes"), "{told}");
}

#[test]
fn parameters_are_compared_with_what_they_began_with_and_with_a_file() {
    let up = start(&[]);
    let diff = |arguments: &[&str]| {
        let output = up
            .command(&[&["vars", "diff"], arguments].concat())
            .output();
        code_and_text(&output.unwrap())
    };
    let none = "8 parameters are compared; none differs\n".to_owned();
    assert_eq!(diff(&[]), (Some(0), none.clone()));
    text(&up, &["vars", "set", "b:joint.stiffness", "1.25"]);
    let (code, table) = diff(&[]);
    assert_eq!(code, Some(1), "{table}");
    let words: Vec<_> = table.lines().nth(1).unwrap().split_whitespace().collect();
    let expected = ["b", "servo", "joint.stiffness", "2.0", "1.25", "N", "m/rad"];
    assert_eq!(words, expected, "{table}");
    let (code, json) = diff(&["--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((code, &json["compared"]), (Some(1), &json!(8)));
    let difference = json!([{
        "processor": "b", "loop": "servo", "name": "joint.stiffness", "unit": "N m/rad",
        "described": 2.0, "present": 1.25
    }]);
    assert_eq!(json["differences"], difference);

    let saved = file(&up, "saved.toml");
    text(&up, &["vars", "save", &saved]);
    assert_eq!(diff(&[&saved]), (Some(0), none));
    text(&up, &["vars", "set", "b:joint.stiffness", "3"]);
    let (code, table) = diff(&[&saved]);
    let row = table.lines().nth(1).unwrap_or_default();
    assert!(row.contains("1.25") && row.contains("3.0"), "{table}");
    assert!(row.contains("saved.toml:"), "{table}");
    assert_eq!((code, table.lines().count()), (Some(1), 2), "{table}");
    let (code, told) = diff(&["/nowhere/saved.toml"]);
    assert_eq!(code, Some(2), "{told}");
    assert!(told.contains("/nowhere/saved.toml"), "{told}");
}
