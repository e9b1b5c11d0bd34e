//! What no peer brings about, whatever it says.
#![cfg(all(feature = "hostile", target_os = "linux"))]

use condor_fs::hostile::{client, host};
use condor_fs::wire::{self, Operation};
use condor_fs::{Errno, FileError};
use proptest::collection::vec;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_client_bears_any_host(bytes in vec(any::<u8>(), 0..400)) {
        host(&bytes);
    }

    #[test]
    fn a_server_bears_any_client(bytes in vec(any::<u8>(), 0..400)) {
        client(&bytes);
    }
}

#[test]
fn a_directory_of_nothing_but_dots_ends() {
    let answer = |own: &crate::peer::Own, slot: u32| {
        let request = crate::peer::request(own, slot).unwrap();
        let mut value = 1;
        if request.operation == Operation::ReadDirectory as u32 {
            // Cookie, kind, length of the name, name.
            let entry = [1, 0, 4, 1, u32::from(b'.')];
            for (word, n) in entry.into_iter().zip(0..) {
                own.set_word(request.buffer.offset + 4 * n, word).unwrap();
            }
            value = 20;
        }
        crate::peer::record(own, slot, &request, Ok(value));
        wire::DONE
    };
    crate::peer::run(answer, |pair| {
        let files = pair.connect().unwrap();
        let mut directory = files.open_directory(".").unwrap();
        let mut name = [0; 8];
        let outcome = directory.next(&mut name);
        assert_eq!(outcome, Err(FileError::Errno(Errno::IO)));
    });
}
