//! Static memory, by its name and at an address that is given.

use condor_mbox::window::WindowErrorKind;
use condor_mbox::{LoadOrder, MemoryWindow, StaticMemory, StaticWindow, StoreOrder};

static MEMORY: StaticMemory<64> = StaticMemory::new();

#[test]
fn it_begins_at_a_cache_line_with_zeros() {
    static FRESH: StaticMemory<20> = StaticMemory::new();
    assert_eq!(std::ptr::from_ref(&FRESH).addr() % 64, 0);
    let window = FRESH.window();
    assert_eq!(window.size(), 80);
    for offset in (0..80).step_by(4) {
        assert_eq!(window.load(offset, LoadOrder::Acquire), Ok(0));
    }
    let error = window.load(80, LoadOrder::Acquire).unwrap_err();
    assert_eq!(
        (error.offset, error.len, error.size, error.kind),
        (80, 4, 80, WindowErrorKind::OutOfBounds)
    );
}

#[test]
fn a_given_address_is_the_same_memory() {
    let words = std::cell::UnsafeCell::new([0_u32; 17]);
    // SAFETY: the array outlives the window, and only the window touches it meanwhile.
    let window = unsafe { StaticWindow::from_raw(words.get().cast(), 67) };
    assert_eq!(window.size(), 64);
    window.store(60, 0x0403_0201, StoreOrder::Release).unwrap();
    assert!(window.store(64, 1, StoreOrder::Release).is_err());
    let words = words.into_inner();
    assert_eq!(words[15].to_le_bytes(), [1, 2, 3, 4]);
    assert_eq!(words[16], 0);
}

#[cfg(feature = "conformance")]
#[test]
fn the_suite_names_what_a_wrong_window_breaks() {
    use condor_mbox::conformance;

    static SMALL: StaticMemory<8> = StaticMemory::new();
    static OTHER: StaticMemory<64> = StaticMemory::new();
    let failure = conformance::shared(&MEMORY.window(), &OTHER.window()).unwrap_err();
    assert_eq!(
        failure.check,
        "the second window loads the word that the first stored"
    );
    let failure = conformance::read_only(&OTHER.window()).unwrap_err();
    assert_eq!(failure.check, "a store is refused");
    let failure = conformance::window(&SMALL.window()).unwrap_err();
    assert_eq!(failure.check, "the window is large enough for the checks");
}
