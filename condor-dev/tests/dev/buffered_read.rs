//! `BufReader` with short reads and errors.

use crate::flaky::{Flaky, script};
use condor_dev::stdio::{BufReader, LineError};
use embedded_io::{ErrorKind, Read as _, ReadExactError};
use proptest::prelude::*;

const N: usize = 8;
/// Miri is some hundred times slower than the machine.
const MANY: usize = if cfg!(miri) { 8 } else { 40 };

/// What a call returned.
#[derive(Debug, PartialEq)]
enum Line {
    Text(Vec<u8>),
    TooLong,
}

/// The lines of some bytes, as a reader with a buffer of `N` bytes returns them to one who has room for `room`.
fn lines(bytes: &[u8], room: usize) -> Vec<Line> {
    let mut lines = Vec::new();
    for line in bytes.split_inclusive(|byte| *byte == 0) {
        // The buffer is dropped each time that it is full of what has no end.
        let (ended, len) = (line.ends_with(&[0]), line.len());
        let drops = (len - usize::from(ended)) / N;
        lines.extend((0..drops).map(|_| Line::TooLong));
        if drops == 0 && len > room {
            lines.push(Line::TooLong);
        } else if drops == 0 {
            lines.push(Line::Text(line.to_vec()));
        }
    }
    lines
}

proptest! {
    #[test]
    fn pieces_are_the_input(
        bytes in prop::collection::vec(0..6_u8, 0..3 * MANY),
        script in script(),
        sizes in prop::collection::vec(1..20_usize, 1..MANY),
    ) {
        let mut reader = BufReader::<_, N>::new(Flaky::new(script, bytes.clone()));
        let mut read = Vec::<u8>::new();
        for size in sizes.iter().cycle() {
            let mut into = vec![0; *size];
            match reader.read(&mut into) {
                Ok(0) => break,
                Ok(count) => read.extend(&into[..count]),
                Err(error) => prop_assert_eq!(error, ErrorKind::TimedOut),
            }
        }
        prop_assert_eq!(read, bytes);
        prop_assert!(reader.inner_mut().asked.iter().all(|asked| *asked <= N));
    }

    #[test]
    fn lines_are_whole_whatever_fails_between(
        bytes in prop::collection::vec(0..6_u8, 0..3 * MANY),
        script in script(),
        room in 1..10_usize,
    ) {
        let mut reader = BufReader::<_, N>::new(Flaky::new(script, bytes.clone()));
        let mut read = Vec::new();
        loop {
            let mut into = vec![0; room];
            match reader.read_line(|byte| byte == 0, &mut into) {
                Ok("") => break,
                Ok(line) => read.push(Line::Text(line.into())),
                Err(LineError::TooLong { .. }) => read.push(Line::TooLong),
                Err(LineError::Reader(error)) => prop_assert_eq!(error, ErrorKind::TimedOut),
                Err(error) => prop_assert!(false, "{error}"),
            }
        }
        prop_assert_eq!(read, lines(&bytes, room));
    }
}

#[test]
fn lines_are_text() {
    let bytes = b"one\n\xfftwo\nthree\nmuch too long\nend".to_vec();
    let mut reader = BufReader::<_, N>::new(Flaky::new([].into(), bytes));
    let mut into = [0; 5];
    let mut next = || {
        reader
            .read_line(|byte| byte == b'\n', &mut into)
            .map(str::to_owned)
    };
    assert_eq!(next(), Ok("one\n".into()));
    assert_eq!(next(), Err(LineError::NotUtf8 { bytes: 5 }));
    assert_eq!(next(), Err(LineError::TooLong { room: 5 }));
    assert_eq!(next(), Err(LineError::TooLong { room: N }));
    assert_eq!(next(), Ok("end".into()));
    assert_eq!(next(), Ok(String::new()));
}

#[test]
fn an_exact_read_needs_all_bytes() {
    let bytes: Vec<u8> = (0..20).collect();
    let mut reader = BufReader::<_, N>::new(Flaky::new([].into(), bytes.clone()));
    let mut exact = [0; 15];
    reader.read_exact(&mut exact).unwrap();
    assert_eq!(exact, bytes[..15]);
    assert_eq!(
        reader.read_exact(&mut exact),
        Err(ReadExactError::UnexpectedEof)
    );
}
