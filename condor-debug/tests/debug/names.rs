//! Files that are no programs.

use condor_debug::names::{Names, NamesError};
use proptest::prelude::*;

proptest! {
    #[test]
    fn any_file_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..200), elf in any::<bool>()) {
        let magic: &[u8] = if elf { b"\x7fELF\x02\x01\x01" } else { b"" };
        let file = [magic, &bytes].concat();
        prop_assert!(matches!(Names::read(&file), Err(NamesError::NoInformation(_))));
    }
}
