//! [`Pace`]: whether a mailbox polls while it waits, or relies on the rings of its doorbell.

use core::time::Duration;

use crate::doorbell::Doorbell;
use crate::time::Instant;

/// The longest duration of a sleep, so that a lost ring only delays.
const NAP: Duration = Duration::from_millis(10);

/// The rules of waiting that follow from [`Doorbell::rings_always`].
#[derive(Clone, Copy)]
pub(super) struct Pace {
    rings_always: bool,
}

impl Pace {
    #[inline(always)]
    pub(super) fn of(doorbell: &impl Doorbell) -> Self {
        let rings_always = doorbell.rings_always();
        Self { rings_always }
    }

    /// Returns true if a message rings, where `asked` tells whether its receiver has asked for rings.
    #[inline(always)]
    pub(super) const fn rings(self, asked: bool) -> bool {
        asked || self.rings_always
    }

    /// Returns true if a wait begins with serving all requests that are there.
    ///
    /// Without polls the number of looks may depend on how fast another processor is. What is
    /// served before its answer then does not.
    #[inline(always)]
    pub(super) const fn serves_first(self) -> bool {
        self.rings_always
    }

    /// Returns true if a wait asks for the state of its peer now, if it does so at `ask_at` at the
    /// latest. Without polls each look follows a ring, which may be that of the peer's end.
    #[inline(always)]
    pub(super) fn asks(self, now: Instant, ask_at: Instant) -> bool {
        now >= ask_at || self.rings_always
    }

    /// Returns the end of a sleep that began at `now`; `ask_at` is `None` if it needs no peer.
    #[inline(always)]
    pub(super) fn sleep_end(
        self,
        now: Instant,
        ask_at: Option<Instant>,
        deadline: Instant,
    ) -> Instant {
        if self.rings_always {
            return deadline;
        }
        ask_at.unwrap_or_else(|| now.after(NAP)).min(deadline)
    }

    /// Returns true if a heart that did not beat during a wait tells of a stalled program.
    #[inline(always)]
    pub(super) const fn feels_hearts(self) -> bool {
        !self.rings_always
    }
}
