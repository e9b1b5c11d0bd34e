//! What is read, and what is said of what cannot be.

use std::collections::BTreeMap;

use condor_toml::{Misreading, SourceText, Spanned, TextErrors, WholeNumber, suggest};
use serde::Deserialize;

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
enum Shape {
    Flat,
    Round(f64),
    Box { sides: [f64; 2] },
}

#[derive(Debug, PartialEq, Deserialize)]
struct Metres(f64);

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Inner {
    deep: Deep,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Deep {
    on: bool,
}

#[derive(Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct All {
    length: Metres,
    shape: Spanned<Shape>,
    joints: BTreeMap<Spanned<String>, u8>,
    inner: Inner,
    name: Option<String>,
}

const RIGHT: &str = "
length = 2
shape = { box = { sides = [1.0, 0x10] } }
joints = { b = 1, \"ä\" = 2 }
[inner.deep]
on = true
";

fn told(text: &str) -> String {
    let text = SourceText::new("f", text);
    text.read::<All>().unwrap_err().to_string()
}

/// Each mistake is found without a look at the text before it: if it were not, this would take hours.
#[test]
fn a_text_may_have_a_hundred_thousand_mistakes() {
    const MANY: usize = 100_000;
    for (begin, between) in [("a = {", ", "), ("[a]\n", "\n")] {
        let keys: Vec<_> = (0..MANY).map(|key| format!("k{key:06} = \"ö\"")).collect();
        let end = if begin.starts_with('[') { "\n" } else { "}\n" };
        let content = format!("{begin}{}{end}", keys.join(between));
        let text = SourceText::new("f", &content);
        let tree = text.parse().unwrap();
        let mut top = text.keys(&tree).unwrap();
        top.table("a").unwrap().finish();
        top.finish();
        let TextErrors(errors) = text.finish(Some(())).unwrap_err();
        assert_eq!(errors.len(), MANY);
        let is_one_line = between == ", ";
        for (place, error) in errors.iter().enumerate() {
            let expected = if is_one_line {
                (1, begin.len() + 1 + 15 * place)
            } else {
                (2 + place, 1)
            };
            assert_eq!((error.line, error.column), expected, "{error}");
        }
    }
}

#[test]
fn a_long_word_is_compared_with_no_short_one() {
    let long = "x".repeat(100_000_000);
    assert_eq!(suggest(&long, &["speed", "x"]), "it can be `speed`, `x`");
    assert_eq!(suggest("sped", &["speed", "x"]), "did you mean `speed`?");
    assert_eq!(suggest("", &["speed"]), "it can be `speed`");
    assert_eq!(suggest("a", &[]), "it has none");
}

#[test]
fn values_and_keys_know_where_they_stand() {
    let all: All = SourceText::new("f", RIGHT).read().unwrap();
    let shape = RIGHT.get(all.shape.span()).unwrap();
    assert_eq!(shape, "{ box = { sides = [1.0, 0x10] } }");
    let joints = all.joints.keys().map(|key| RIGHT.get(key.span()).unwrap());
    assert!(joints.eq(["b", "\"ä\""]));
    let sides = [1.0, 16.0];
    assert_eq!(*all.shape.get_ref(), Shape::Box { sides });
    assert_eq!((all.length, all.name), (Metres(2.0), None));
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    for (from, to, expected) in [
        (
            "= 2\n",
            "= \n",
            "f:2:10: string values must be quoted, expected literal string",
        ),
        (
            "= 2\n",
            "= 1988-01-01\n",
            "f:2:10: a time stands where a number should be\n    1988-01-01",
        ),
        (
            "= 2\n",
            "= 99999999999999999999\n",
            "f:2:10: 99999999999999999999 stands where a number of 64 bits should be\n    99999999999999999999",
        ),
        (
            "{ box = { sides = [1.0, 0x10] } }",
            "\"flad\"",
            "f:3:9: `flad` is none of the choices here; did you mean `flat`?\n    \"flad\"",
        ),
        (
            "box =",
            "flat =",
            "f:3:11: a table stands where the word \"flat\" should be\n    flat",
        ),
        (
            "0x10",
            "true",
            "f:3:33: `true` stands where a number should be\n    true",
        ),
        (
            ", 0x10",
            "",
            "f:3:27: the list must have 2 entries, not 1\n    [1.0]",
        ),
        (
            "2 }",
            "256 }",
            "f:4:25: the number 256 stands where a whole number from 0 to 255 should be\n    256",
        ),
        (
            "2 }",
            "[] }",
            "f:4:25: a list stands where a whole number from 0 to 255 should be\n    []",
        ),
        (
            "on = true",
            "",
            "f:5:1: the key `on` is missing here\n    [inner.deep]",
        ),
        (
            "on = true",
            "off = true",
            "f:6:1: there is no key `off` here; did you mean `on`?\n    off",
        ),
        (
            "[inner.deep]\non = true",
            "inner.deep = 1",
            "f:5:14: the number 1 stands where a table should be\n    1",
        ),
        ("length = 2", "", "f:1:1: the key `length` is missing here"),
    ] {
        let text = RIGHT.replacen(from, to, 1);
        assert_ne!(text, RIGHT);
        assert_eq!(told(&text), expected);
    }
}

fn read(text: &str) -> Result<(Vec<String>, i8), TextErrors> {
    let text = SourceText::new("f", text);
    let tree = text.parse()?;
    let mut top = text.keys(&tree).unwrap();
    let mut names = Vec::new();
    for mut row in top.tables("rows", "`[[rows]]`") {
        names.extend(row.need::<String>("name", "what it is called"));
        row.word("kind", &[("big", ()), ("small", ())]);
        row.finish();
    }
    let level: Option<Spanned<WholeNumber<i8, -100, 100, 10>>> = top.get("level");
    if let Some(level) = &level {
        if level.get_ref().0 == 50 {
            top.wrong(&level.span(), "50 is not there today");
        }
        assert_eq!(top.line(level.span().start), 1);
    }
    top.finish();
    text.finish(level.map(|level| (names, level.get_ref().0)))
}

#[test]
fn all_mistakes_are_told_in_the_order_of_the_lines() {
    let right = "level = -20\n[[rows]]\nname = \"a\"\nkind = \"big\"";
    assert_eq!(read(right), Ok((vec!["a".into()], -20)));
    let told = |text| read(text).unwrap_err().to_string();
    assert_eq!(
        told("level = 15\nlevle = 20\n[[rows]]\nkind = \"bigg\"\n[[rows]]\nname = 3\n"),
        "f:1:9: the number 15 stands where a multiple of 10 from -100 to 100 should be\n    15\n\
         f:2:1: there is no key `levle` here; did you mean `level`?\n    levle\n\
         f:3:1: the key `name` is missing here; it is what it is called\n    [[rows]]\n\
         f:4:8: `bigg` is none of the choices here; did you mean `big`?\n    \"bigg\"\n\
         f:6:8: the number 3 stands where a text should be\n    3"
    );
    assert_eq!(
        told("level = 50\nrows = 1"),
        "f:1:9: 50 is not there today\n    50\nf:2:8: the number 1 stands where `[[rows]]` should be\n    1"
    );
    assert!(told("level = 10\nrows = [1]").starts_with("f:2:9: the number 1 stands where a table"));
    assert!(told("a = 1\na = 2").starts_with("f:2:1: duplicate key"));
}

#[test]
fn a_place_is_in_characters_and_an_excerpt_in_one_line() {
    let content = "ä = \"\"\"b\nc\"\"\"";
    let text = SourceText::new("f", content);
    let error = text.error(Misreading::at(&(5..content.len()), "no"));
    assert_eq!((error.line, error.column), (1, 5));
    assert_eq!(error.text, "\"\"\"b");
    let error = text.error(Misreading::at(&(99..100), "no"));
    assert_eq!((error.line, error.column, error.text.as_str()), (2, 5, ""));
    assert_eq!(suggest("x", &[]), "it has none");
    assert_eq!(suggest("x", &["one", "two"]), "it can be `one`, `two`");
}
