//! The suites of `condor-mbox` for the backends of this machine.

use condor_mbox::{Doorbell, MemoryWindow as _, StoreOrder, Windows, conformance};

use crate::map::{Window, windows};
use crate::{Checks, LEADER};

/// Checks the memory, which no processor uses yet.
pub fn memories(checks: &mut Checks<'_>) {
    checks.group("backends");
    let [Windows { mail, data }, _] = windows();
    window(checks, &mail);
    window(checks, &data);
}

fn window(checks: &mut Checks<'_>, window: &Window) {
    checks.same(conformance::window(window), Ok(()));
    checks.same(conformance::shared(window, window), Ok(()));
    let mut at = 0;
    while window.store(at, 0, StoreOrder::Relaxed).is_ok() {
        at += 4;
    }
}

/// Checks the doorbell of the leader, which has not joined yet; `ring` rings it as the follower does.
pub fn doorbell<D: Doorbell>(checks: &mut Checks<'_>, bell: &D, ring: impl Fn()) {
    checks.same(conformance::doorbell(bell, LEADER, ring), Ok(()));
}
