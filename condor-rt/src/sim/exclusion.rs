//! [`Uninterrupted`]: sections of a processor in virtual time.

use std::sync::Arc;

use condor_mbox::Exclusion;

use super::time::Core;

/// Critical sections in which no time passes, so that nothing interrupts them. All clones are the
/// same.
#[derive(Clone)]
pub struct Uninterrupted(pub(super) Arc<Core>);

impl Exclusion for Uninterrupted {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        self.0.standing_still(body)
    }
}
