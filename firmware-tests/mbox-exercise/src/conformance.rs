//! The suites of `condor-mbox` for the backends of this machine.

use condor_mbox::{Doorbell, MemoryWindow, Processor, conformance};

use crate::Checks;

/// A window that nobody uses yet, twice.
pub fn window<W: MemoryWindow + Clone>(checks: &mut Checks<'_>, window: &W) {
    checks.same(
        "the window keeps its promises",
        conformance::window(window),
        Ok(()),
    );
    checks.same(
        "it is one memory for all who have it",
        conformance::shared(window, &window.clone()),
        Ok(()),
    );
    let mut at = 0;
    while window
        .store(at, 0, condor_mbox::StoreOrder::Relaxed)
        .is_ok()
    {
        at += 4;
    }
}

/// The doorbell of `me`, who has not joined yet; `ring` rings it as another processor does.
pub fn doorbell<D: Doorbell>(checks: &mut Checks<'_>, bell: &D, me: Processor, ring: impl Fn()) {
    checks.same(
        "the doorbell keeps its promises",
        conformance::doorbell(bell, me, ring),
        Ok(()),
    );
}
