//! `BufReader` beside std's, with the same short reads and errors.

use std::io::{self, BufRead as _, Read as _};

use crate::flaky::{Flaky, script};
use condor_dev::stdio::{BufReader, LineError, ReadLine as _, UntilError};
use embedded_io::{BufRead as _, ErrorKind, Read as _};
use proptest::prelude::*;

const N: usize = 8;
/// Miri is some hundred times slower than the machine.
const MANY: usize = if cfg!(miri) { 8 } else { 40 };

#[derive(Clone, Debug)]
enum Step {
    Read(usize),
    Fill(usize),
    Until(u8),
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let step = prop_oneof![
        (0..20_usize).prop_map(Step::Read),
        (0..10_usize).prop_map(Step::Fill),
        (0..6_u8).prop_map(Step::Until),
    ];
    prop::collection::vec(step, 0..MANY)
}

fn kind<T>(result: io::Result<T>) -> Result<T, ErrorKind> {
    result.map_err(|error| match error.kind() {
        io::ErrorKind::TimedOut => ErrorKind::TimedOut,
        _ => ErrorKind::Other,
    })
}

proptest! {
    #[test]
    fn it_reads_as_std_does(
        bytes in prop::collection::vec(0..6_u8, 0..3 * MANY),
        script in script(),
        steps in steps(),
    ) {
        let mut ours = BufReader::<_, N>::new(Flaky::new(script.clone(), bytes.clone()));
        let mut stds = io::BufReader::with_capacity(N, Flaky::new(script, bytes));
        for step in steps {
            match step {
                Step::Read(count) => {
                    let (mut a, mut b) = ([0; 20], [0; 20]);
                    let expected = kind(stds.read(&mut b[..count]));
                    prop_assert_eq!(ours.read(&mut a[..count]), expected);
                    prop_assert_eq!(a, b);
                }
                Step::Fill(count) => {
                    let expected = kind(stds.fill_buf().map(<[u8]>::to_vec));
                    let filled = ours.fill_buf().map(<[u8]>::to_vec);
                    prop_assert_eq!(&filled, &expected);
                    let count = count.min(filled.map_or(0, |filled| filled.len()));
                    ours.consume(count);
                    stds.consume(count);
                }
                Step::Until(delimiter) => {
                    let (mut a, mut b) = ([0; 200], Vec::new());
                    let expected = kind(stds.read_until(delimiter, &mut b));
                    let taken = ours.read_until(delimiter, &mut a);
                    let read = match taken {
                        Ok(read) => {
                            prop_assert_eq!(Ok(read), expected);
                            read
                        }
                        Err(UntilError { read, error }) => {
                            prop_assert_eq!(Err(error), expected);
                            read
                        }
                    };
                    prop_assert_eq!(&a[..read], &b);
                }
            }
            prop_assert_eq!(&ours.reader().asked, &stds.get_ref().asked);
        }
    }

    #[test]
    fn pieces_are_the_input_however_small_the_memory(
        bytes in prop::collection::vec(0..6_u8, 0..3 * MANY),
        script in script(),
        sizes in prop::collection::vec(1..20_usize, 1..MANY),
    ) {
        let mut reader = BufReader::<_, N>::new(Flaky::new(script, bytes.clone()));
        let mut read = Vec::<u8>::new();
        for size in sizes.iter().cycle() {
            let mut into = vec![0; *size];
            match reader.read_until(0, &mut into) {
                Ok(bytes) => {
                    read.extend(&into[..bytes]);
                    let (last, others) = into[..bytes].split_last().map_or((None, &[][..]), |(last, others)| (Some(*last), others));
                    prop_assert!(!others.contains(&0));
                    if bytes < *size && last != Some(0) {
                        break;
                    }
                }
                Err(UntilError { read: some, error }) => {
                    prop_assert_eq!(error, ErrorKind::TimedOut);
                    read.extend(&into[..some]);
                }
            }
        }
        prop_assert_eq!(read, bytes);
    }
}

#[test]
fn lines_are_text() {
    let bytes = b"one\n\xfftwo\nthree is long\nend".to_vec();
    let mut reader = BufReader::<_, N>::new(Flaky::new([].into(), bytes));
    let mut into = [0; 9];
    assert_eq!(reader.read_line(&mut into), Ok("one\n"));
    let garbled = LineError::NotUtf8 { read: 5 };
    assert_eq!(reader.read_line(&mut into), Err(garbled));
    let long = LineError::TooLong { read: 9 };
    assert_eq!(reader.read_line(&mut into), Err(long));
    assert_eq!(&into, b"three is ");
    assert_eq!(reader.read_line(&mut into), Ok("long\n"));
    assert_eq!(reader.read_line(&mut into), Ok("end"));
    assert_eq!(reader.read_line(&mut into), Ok(""));
}
