//! Texts and images of hands: valid ones with faults, and bytes of no meaning.
//!
//! A hand that is read keeps all rules, and stays the same when it is written as an image and read again.

use std::sync::LazyLock;

use super::source::Source;
use super::{HAND, Shipped, TEXT};
use crate::image::{Format, HEADER_BYTES};

static IMAGE: LazyLock<Vec<u8>> = LazyLock::new(|| image(&HAND));

/// The words that replace a number or a word of a valid text.
const REPLACEMENTS: [&str; 20] = [
    "0",
    "-0.0",
    "1",
    "-1",
    "0.5",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "1e-320",
    "4294967296",
    "-9223372036854775808",
    "\"index\"",
    "\"\"",
    "[]",
    "{}",
    "true",
    "=",
    "\n",
    "[[fingers]]",
];

/// Runs a fuzz scenario: reads the text or the image of a hand that `bytes` describe, and checks the result.
///
/// # Panics
/// Panics if a hand that breaks the rules is read, or if a hand differs after it was written and read again.
pub fn run(bytes: &[u8]) {
    let mut source = Source::new(bytes);
    match source.byte() % 5 {
        0 => read_text(&String::from_utf8_lossy(source.rest())),
        1 => read_image(source.rest()),
        2 => read_image(&sealed(source.rest())),
        3 => read_text(&edited(&mut source)),
        _ => {
            let mut image = IMAGE.clone();
            let len = image.len();
            while !source.is_empty() {
                image[source.below(len)] = source.byte();
            }
            seal(&mut image);
            read_image(&image);
        }
    }
}

fn read_text(text: &str) {
    match Shipped::from_toml(text, "hostile.toml") {
        Ok(hand) => keeps_its_promises(&hand),
        Err(error) => assert!(error.line > 0 && !error.to_string().is_empty()),
    }
}

fn read_image(bytes: &[u8]) {
    match Shipped::from_image(bytes) {
        Ok(hand) => keeps_its_promises(&hand),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

fn keeps_its_promises(hand: &Shipped) {
    hand.check().expect("what was read keeps the rules");
    let before = image(hand);
    let again = Shipped::from_image(&before).expect("an image is read again");
    assert_eq!(image(&again), before, "an image of an image");
}

fn image(hand: &Shipped) -> Vec<u8> {
    let mut buffer = vec![0; 1 << 16];
    let len = hand.to_image(&mut buffer).expect("a hand has an image");
    buffer.truncate(len);
    buffer
}

/// Returns the valid text with some words exchanged, and some lines left out or repeated.
fn edited(source: &mut Source<'_>) -> String {
    let mut text = TEXT.to_owned();
    for _ in 0..4 {
        if source.is_empty() {
            break;
        }
        text = if source.byte() < 200 {
            exchanged(&text, source)
        } else {
            let count = text.lines().count().max(1);
            let (at, copies) = (source.below(count), source.below(3));
            let lines = text.lines().enumerate();
            lines
                .flat_map(|(line, text)| {
                    let copies = if line == at { copies } else { 1 };
                    std::iter::repeat_n([text, "\n"].concat(), copies)
                })
                .collect()
        };
    }
    text
}

fn exchanged(text: &str, source: &mut Source<'_>) -> String {
    let is_word = |character: char| character.is_ascii_alphanumeric() || "+-._".contains(character);
    let words: Vec<&str> = text.split(|character| !is_word(character)).collect();
    let words: Vec<&str> = words.into_iter().filter(|word| !word.is_empty()).collect();
    if words.is_empty() {
        return text.to_owned();
    }
    let word = words[source.below(words.len())];
    let begin = word.as_ptr() as usize - text.as_ptr() as usize;
    let (before, after) = (&text[..begin], &text[begin + word.len()..]);
    let other = match source.byte() {
        choice if usize::from(choice) < REPLACEMENTS.len() => REPLACEMENTS[usize::from(choice)],
        _ => words[source.below(words.len())],
    };
    [before, other, after].concat()
}

/// Returns an image of `body` with a header that fits it, and with the counts of the valid image.
fn sealed(body: &[u8]) -> Vec<u8> {
    let mut image = IMAGE[..HEADER_BYTES].to_vec();
    image.extend_from_slice(body);
    seal(&mut image);
    image
}

/// Writes the right length and checksum into the header of an image, and leaves its magic, version and fields.
fn seal(image: &mut [u8]) {
    if let Some((header, body)) = image.split_first_chunk_mut::<HEADER_BYTES>() {
        let [a, b, c, d, v0, v1, fields @ .., _, _, _, _, _, _, _, _] = *header;
        let version = u16::from_le_bytes([v0, v1]);
        let magic = [a, b, c, d];
        Format { magic, version }.seal(fields, header, body);
    }
}
