//! A claimed value is one context's.

use condor_dev::ClaimCell;

#[test]
fn threads_do_not_share_it() {
    const ROUNDS: u32 = if cfg!(miri) { 50 } else { 5_000 };
    let claim = ClaimCell::new(0_u32);
    let count = || {
        let mut counted = 0;
        for _ in 0..ROUNDS {
            if let Some(mut value) = claim.claim() {
                assert!(claim.claim().is_none());
                *value += 1;
                counted += 1;
            }
        }
        counted
    };
    let counted: u32 = std::thread::scope(|scope| {
        let other = scope.spawn(count);
        count() + other.join().unwrap()
    });
    assert_eq!(*claim.claim().unwrap(), counted);
}
