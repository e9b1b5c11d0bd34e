//! The suites of `condor-mbox` for the backends of this machine.

use condor_mbox::{MemoryWindow as _, StoreOrder, Windows, conformance};
use firmware::Checks;

use crate::map::windows;
use crate::{Bell, LEADER, Window};

/// Checks the memory, which no processor uses yet.
pub(crate) fn memories(checks: &mut Checks) {
    checks.group("backends");
    let [Windows { mail, data }, _] = windows();
    window(checks, &mail);
    window(checks, &data);
}

fn window(checks: &mut Checks, window: &Window) {
    checks.same(conformance::window(window), Ok(()));
    checks.same(conformance::shared(window, window), Ok(()));
    let mut at = 0;
    while window.store(at, 0, StoreOrder::Relaxed).is_ok() {
        at += 4;
    }
}

/// Checks the doorbell of the leader; `ring` rings it as the follower does.
pub(crate) fn doorbell(checks: &mut Checks, bell: Bell, ring: impl Fn()) {
    checks.same(conformance::doorbell(&bell, LEADER, ring), Ok(()));
}
