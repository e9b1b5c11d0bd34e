//! Whatever is written to the window, or asked: no panic, no end that does not come, nothing written
//! outside of the table.

use proptest::prelude::*;

use crate::haunted;

proptest! {
    #[test]
    fn both_ends_bear_anything(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        haunted::run(&bytes);
    }
}
