//! What `settle` tells is the result of the call that was in doubt, and of no other.
#![cfg(all(feature = "hostile", target_os = "linux"))]

use std::sync::{Arc, Mutex};

use crate::peer::{Own, Pair, TIMEOUT};
use condor_fs::wire::{self, Operation};
use condor_fs::{FileError, OpenOptions};
use embedded_io::SeekFrom;

/// What has been asked.
type Asked = Arc<Mutex<Vec<Operation>>>;

/// A host where all goes well: its files have no end.
fn with_host(program: impl FnOnce(&Pair, &Asked)) {
    let asked = Asked::default();
    let seen = asked.clone();
    let answer = move |own: &Own, slot: u32| {
        let request = crate::peer::request(own, slot).unwrap();
        let operation = Operation::from_word(request.operation).unwrap();
        seen.lock().unwrap().push(operation);
        let value = match operation {
            Operation::Session => 1,
            _ => request.buffer.len.into(),
        };
        crate::peer::record(own, slot, &request, Ok(value));
        wire::DONE
    };
    crate::peer::run(answer, |pair| program(pair, &asked));
}

const READ: OpenOptions = OpenOptions::new().read();

#[test]
fn the_closing_of_a_dropped_file_is_not_the_open_that_waited_for_it() {
    with_host(|pair, asked| {
        let fs = pair.connect().unwrap();
        drop(fs.open("old", READ).unwrap());
        pair.stall(true);
        let new = fs.open("new", OpenOptions::new().write().exclusive()).err();
        assert!(matches!(new, Some(FileError::NotBegun { .. })), "{new:?}");
        assert!(fs.in_doubt());
        pair.stall(false);
        assert_eq!(fs.settle(TIMEOUT), Ok(None));
        assert!(!fs.in_doubt());
        let asked = asked.lock().unwrap();
        assert_eq!(
            *asked,
            [Operation::Session, Operation::Open, Operation::Close]
        );
    });
}

#[test]
fn a_call_that_waits_for_one_in_doubt_is_not_begun() {
    with_host(|pair, asked| {
        let fs = pair.connect().unwrap();
        let mut file = fs.open("file", READ.write()).unwrap();
        pair.stall(true);
        let late = file.write(b"three").unwrap_err();
        assert!(matches!(late, FileError::TimedOut { .. }), "{late}");
        for error in [
            fs.unlink("file").unwrap_err(),
            file.read(&mut [0; 8]).unwrap_err(),
            file.seek(SeekFrom::End(0)).unwrap_err(),
            fs.open("other", READ).err().unwrap(),
        ] {
            assert!(matches!(error, FileError::NotBegun { .. }), "{error}");
        }
        pair.stall(false);
        assert_eq!(fs.settle(TIMEOUT), Ok(Some(Ok(5))), "the write");
        assert_eq!(fs.settle(TIMEOUT), Ok(None));
        let asked = asked.lock().unwrap();
        assert_eq!(
            *asked,
            [Operation::Session, Operation::Open, Operation::Write]
        );
    });
}

#[test]
fn what_a_call_asks_first_is_not_its_result() {
    with_host(|pair, _| {
        let fs = pair.connect().unwrap();
        let mut file = fs.open("file", READ.write()).unwrap();
        let late = |outcome: Result<u64, FileError>| {
            let error = outcome.unwrap_err();
            assert!(matches!(error, FileError::TimedOut { .. }), "{error}");
            pair.stall(false);
            assert_eq!(fs.settle(TIMEOUT), Ok(None));
        };
        pair.stall(true);
        late(file.seek(SeekFrom::End(7)));
        assert_eq!(file.position(), Ok(0), "it was not moved");
    });
}
