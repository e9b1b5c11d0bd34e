//! Any words in the area, as the fuzz target has them.

use proptest::prelude::*;

proptest! {
    #[test]
    fn a_stub_bears_any_words(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        super::hostile::run(&bytes);
    }
}
