//! A screen shows what a person would see, and stands whatever is written to it.
#![cfg(feature = "screen")]

use std::num::NonZero;

use condor_tty::linux::{Piece, Screen, Sink};
use proptest::prelude::*;

fn screen(rows: u16, columns: u16) -> Screen {
    Screen::new(
        NonZero::new(rows).unwrap(),
        NonZero::new(columns).unwrap(),
        10,
    )
}

#[test]
fn it_shows_what_a_person_sees() {
    let mut screen = screen(2, 20);
    screen
        .take(b"one\r\ntwo\r\nthrex\x08 \x08e \x1b[1mbold".into())
        .unwrap();
    assert_eq!(screen.screen().contents(), "two\nthree bold");
    screen.screen_mut().set_scrollback(1);
    assert_eq!(screen.screen().contents(), "one\ntwo");
    let overwritten = 7;
    screen
        .take(Piece {
            overwritten,
            ..Piece::default()
        })
        .unwrap();
    assert_eq!(screen.overwritten_bytes(), 7);
}

proptest! {
    #[test]
    fn it_stands_everything(rows in 1_u16..5, columns in 1_u16..5, text in prop::collection::vec(
        prop_oneof![any::<u8>(), Just(0x1b), Just(b'['), b'0'..=b'9', Just(b';'), b'A'..=b'Z', Just(b'm')], 0..200)) {
        let mut screen = screen(rows, columns);
        prop_assert_eq!(screen.take((&text).into()).unwrap(), text.len());
        let _ = screen.screen().contents();
    }
}
