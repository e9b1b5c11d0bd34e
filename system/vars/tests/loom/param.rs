//! A parameter is set while the loop latches it.

use condor_vars::{Param, Tune};
use loom::sync::Arc;
use loom::thread;

/// Both words of a value are equal.
const fn value(number: u64) -> u64 {
    number << 32 | number
}

/// Unbounded. Fails if either of the fences is left out.
#[test]
fn a_loop_never_sees_half_of_a_value() {
    loom::model(|| {
        let param = Arc::new(Param::new("p", "", value(1), value(1)..=value(9)));
        let setter = Arc::clone(&param);
        let setting = thread::spawn(move || {
            setter.compare_and_set(value(1), value(2)).unwrap();
            setter.compare_and_set(value(2), value(3)).unwrap();
        });
        let mut former = 1;
        for _ in 0..2 {
            param.latch();
            let present = param.get();
            assert_eq!(present, value(present & 0xff));
            assert!(present & 0xff >= former, "it went backwards");
            former = present & 0xff;
        }
        setting.join().unwrap();
        param.latch();
        assert_eq!(param.get(), value(3));
    });
}
