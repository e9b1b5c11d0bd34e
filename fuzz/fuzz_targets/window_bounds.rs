//! No offset and length that pass the check reach outside of a window, and all others are refused.
#![no_main]

use condor_mbox::check_access;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|access: (u32, u32, u64)| {
    let (size, offset, len) = access;
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    let end = u128::from(offset) + len as u128;
    let inside = offset % 4 == 0 && end <= u128::from(size);
    assert_eq!(check_access(size, offset, len).is_ok(), inside);
});
