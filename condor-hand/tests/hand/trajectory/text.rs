//! Motions as text.

use condor_hand::config::TextError;
use condor_hand::trajectory::{
    Begin, Guards, OnEnd, Pace, Primitive, Profile, Target, Via, motion::load,
};
use proptest::prelude::*;

const NAMES: [&str; 4] = ["index.1", "index.2", "thumb \"tip\"", "ü\n"];

const TEXT: &str = r#"# Close and open.
[[motion]]
profile = "cubic"
duration = 1
on-end = "hold"
stop = { torque = 0.2, contact = true }
to = { "index.1" = 0.5 }

[motion.by]
"index.2" = -0.1

[[motion.via]]
at = 0.5
joints = { "index.1" = 0.7, "index.2" = 0.0 }

[[motion]]
profile = "trapezoid"
speed = 0.5
begin = "beside"
blend = 0.1
start.time = 2.5
[motion.to]
"index.1" = 0
"#;

fn read(text: &str) -> Result<Vec<Primitive<4>>, TextError> {
    load(text, "motion.toml", &NAMES)
}

#[test]
fn text_says_what_to_do() {
    let mut first = Primitive::new(Pace::Duration(1.0), Profile::Cubic)
        .with(0, Target::Absolute(0.5))
        .and_then(|motion| motion.with(1, Target::Relative(-0.1)))
        .unwrap();
    first.on_end = OnEnd::Hold;
    first.stop = Guards {
        torque: Some(0.2),
        contact: true,
        ..Guards::none()
    };
    let positions = [0.7, 0.0, 0.0, 0.0];
    first.vias.push(Via { at: 0.5, positions }).unwrap();
    let mut second = Primitive::new(Pace::Speed(0.5), Profile::Trapezoid)
        .with(0, Target::Absolute(0.0))
        .unwrap();
    second.begin = Begin::Beside;
    second.blend = 0.1;
    second.start.time = Some(2.5);
    assert_eq!(read(TEXT).unwrap(), [first, second]);
    assert_eq!(read("").unwrap(), []);
}

#[test]
fn errors_have_a_place_and_say_what_would_be_right() {
    for (from, to, place, says) in [
        ("\"cubic\"", "\"cubik\"", (3, 11), "did you mean `cubic`?"),
        (
            "duration = 1",
            "duratoin = 1",
            (4, 1),
            "did you mean `duration`?",
        ),
        ("duration = 1", "", (2, 1), "give `duration = `"),
        (
            "duration = 1",
            "duration = 1\nspeed = 1",
            (2, 1),
            "either `duration` or `speed`",
        ),
        (
            "duration = 1",
            "duration = \"long\"",
            (4, 12),
            "where a number should be",
        ),
        ("duration = 1", "duration = -1", (2, 1), "must be above 0"),
        ("duration = 1", "duration = ", (4, 12), ""),
        (
            "{ \"index.1\" = 0.5 }",
            "{ \"indx.1\" = 0.5 }",
            (7, 8),
            "there are \"index.1\", ",
        ),
        (
            "{ \"index.1\" = 0.5 }",
            "{ \"index.1\" = nan }",
            (7, 8),
            "index.1: the position, rad, is NaN; it must be finite",
        ),
        (
            "{ \"index.1\" = 0.5 }",
            "{ \"index.2\" = 0.5 }",
            (10, 1),
            "in `to` and in `by`",
        ),
        (
            "at = 0.5",
            "at = 1.5",
            (12, 1),
            "is 1.5; it must be below 1",
        ),
        ("{ \"index.1\" = 0.7, ", "{ ", (12, 1), "lacks \"index.1\""),
        (
            "0.7, \"index.2\"",
            "0.7, \"ü\\n\"",
            (14, 29),
            "neither in `to`",
        ),
        (
            "{ torque = 0.2",
            "{ force = 0.2",
            (6, 10),
            "did you mean `torque`?",
        ),
        (
            "[motion.to]\n\"index.1\" = 0",
            "",
            (16, 1),
            "give `[motion.to]` or",
        ),
    ] {
        let text = TEXT.replacen(from, to, 1);
        assert_ne!(text, TEXT);
        let error = read(&text).unwrap_err();
        assert_eq!((error.line, error.column), place, "{to}: {error}");
        assert!(error.problem.contains(says), "{to}: {error}");
    }
}

proptest! {
    #[test]
    fn any_text_is_an_error_or_a_motion(text in ".{0,60}", cut in 0..TEXT.len()) {
        let _ = read(&text);
        let text = format!("{}{text}", &TEXT[..cut]);
        if let Err(error) = read(&text) {
            prop_assert!(error.line <= text.matches('\n').count() + 1 && error.column >= 1);
        }
    }
}
