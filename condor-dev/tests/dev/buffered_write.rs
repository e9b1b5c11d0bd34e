//! `BufWriter` beside std's, with short writes and errors.

use std::io::{self, Write as _};

use crate::flaky::{Flaky, Script, script};
use condor_dev::stdio::{BufWriter, Buffering, WriteError};
use embedded_io::{Error as _, ErrorKind, Write as _};
use proptest::prelude::*;

const N: usize = 8;
/// Miri is some hundred times slower than the machine.
const MANY: usize = if cfg!(miri) { 8 } else { 40 };

#[derive(Clone, Debug)]
enum Step {
    Write(Vec<u8>),
    Flush,
}

fn text() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![1 => Just(b'\n'), 5 => b'a'..=b'z'];
    prop::collection::vec(byte, 0..20)
}

fn buffering() -> impl Strategy<Value = Buffering> {
    prop_oneof![
        Just(Buffering::None),
        Just(Buffering::Line),
        Just(Buffering::Block)
    ]
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        4 => text().prop_map(Step::Write),
        1 => Just(Step::Flush),
    ];
    prop::collection::vec(step, 0..MANY)
}

/// What the writer has, and what is held.
fn all<const N: usize>(writer: &mut BufWriter<Flaky, N>) -> Vec<u8> {
    let held = writer.held().to_vec();
    [&writer.inner_mut().bytes[..], &held].concat()
}

fn nothing_is_lost<const N: usize>(
    script: Script,
    steps: Vec<Step>,
    buffering: Buffering,
) -> Result<(), TestCaseError> {
    let mut writer = BufWriter::<_, N>::new(Flaky::new(script, Vec::new()), buffering);
    let mut accepted = Vec::<u8>::new();
    for step in steps {
        let (result, bytes) = match step {
            Step::Write(bytes) => (writer.write(&bytes), bytes),
            Step::Flush => (writer.flush().map(|()| 0), Vec::new()),
        };
        match result {
            Ok(count) => {
                prop_assert!(count <= bytes.len() && (count > 0 || bytes.is_empty()));
                accepted.extend(&bytes[..count]);
            }
            Err(WriteError::Writer(error)) => {
                prop_assert_eq!(error, ErrorKind::TimedOut);
            }
            Err(other) => prop_assert!(false, "{other:?}"),
        }
        prop_assert_eq!(&all(&mut writer), &accepted);
    }
    while writer.flush().is_err() {}
    prop_assert_eq!(&writer.inner_mut().bytes, &accepted);
    prop_assert!(writer.held().is_empty());
    Ok(())
}

/// Writes all of it, whatever fails on the way.
fn insist(mut rest: &[u8], mut write: impl FnMut(&[u8]) -> Option<usize>) {
    while !rest.is_empty() {
        rest = &rest[write(rest).unwrap_or(0)..];
    }
}

/// Writes whose calls all succeed, and all that is written.
fn reliable() -> Script {
    Script::new()
}

proptest! {
    #[test]
    fn nothing_is_lost_or_doubled(script in script(), steps in steps(), first in buffering()) {
        nothing_is_lost::<N>(script.clone(), steps.clone(), first)?;
        nothing_is_lost::<1>(script, steps, first)?;
    }

    #[test]
    fn lines_arrive_no_later_than_with_std(texts in prop::collection::vec(text(), 0..MANY / 2)) {
        let flaky = || Flaky::new(reliable(), Vec::new());
        let mut ours = BufWriter::<_, N>::new(flaky(), Buffering::Line);
        let mut stds = io::LineWriter::with_capacity(N, flaky());
        for text in &texts {
            insist(text, |rest| ours.write(rest).ok());
            insist(text, |rest| stds.write(rest).ok());
            let lines = |bytes: &[u8]| bytes.iter().rposition(|byte| *byte == b'\n');
            prop_assert_eq!(lines(&ours.inner_mut().bytes), lines(&stds.get_ref().bytes));
            prop_assert!(!ours.held().contains(&b'\n'));
        }
    }

    #[test]
    fn a_line_that_is_owed_comes_before_anything_else(script in script(), steps in steps()) {
        let mut writer = BufWriter::<_, N>::new(Flaky::new(script, Vec::new()), Buffering::Line);
        for step in steps {
            let owed = writer.held().contains(&b'\n');
            let taken = match step {
                Step::Write(bytes) => writer.write(&bytes),
                Step::Flush => continue,
            };
            if let Ok(count @ 1..) = taken && owed {
                // All that is still held was taken by this call.
                prop_assert!(writer.held().len() <= count);
            }
        }
    }
}

#[test]
fn a_buffer_is_written_at_once() {
    let mut writer = BufWriter::<_, N>::new(Flaky::default(), Buffering::Block);
    for byte in b"abcdefghijklmnopqr" {
        writer.write_all(&[*byte]).unwrap();
    }
    assert_eq!(writer.inner_mut().asked, [8, 8]);
    assert_eq!(writer.held(), b"qr");
    writer.flush().unwrap();
    // The last one is the flush of the writer itself.
    assert_eq!(writer.inner_mut().asked, [8, 8, 2, 0]);
}

#[test]
fn what_an_error_left_is_held() {
    let script = [Some(2), None].into();
    let mut writer = BufWriter::<_, N>::new(Flaky::new(script, Vec::new()), Buffering::Block);
    writer.write_all(b"abcdef").unwrap();
    let error = writer.flush().unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TimedOut);
    assert_eq!(error.to_string(), "TimedOut");
    assert_eq!(writer.held(), b"cdef");
}

/// A writer that breaks the rules of `embedded-io`.
struct Stubborn;

impl embedded_io::ErrorType for Stubborn {
    type Error = ErrorKind;
}

impl embedded_io::Write for Stubborn {
    fn write(&mut self, _: &[u8]) -> Result<usize, ErrorKind> {
        Ok(0)
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

#[test]
fn a_writer_that_takes_nothing_is_an_error() {
    let mut writer = BufWriter::<_, N>::new(Stubborn, Buffering::Block);
    assert_eq!(writer.write(&[1; 9]), Ok(N));
    assert_eq!(writer.write(&[1]), Err(WriteError::Zero));
    let error = writer.flush().unwrap_err();
    assert_eq!(error, WriteError::Zero);
    assert_eq!(error.kind(), ErrorKind::WriteZero);
}
