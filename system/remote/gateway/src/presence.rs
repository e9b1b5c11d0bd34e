//! [`Presence`]: which clients are there, and whose motions stop when they are gone.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

/// The clients that say that they are there, and the rules for those that do not.
#[derive(Debug)]
pub(crate) struct Presence {
    /// Clients whose motions must not run on.
    stops: BTreeSet<String>,
    grace: Duration,
    began: Instant,
    /// The tokens of each client that are there.
    here: BTreeMap<String, BTreeSet<u64>>,
    /// Since when a client is not there.
    gone: BTreeMap<String, Instant>,
}

impl Presence {
    /// Makes it for clients of which nobody is known to be there. Motions of those in `stops` stop `grace` after their
    /// client was last there, or after `now`.
    #[must_use]
    pub(crate) const fn new(stops: BTreeSet<String>, grace: Duration, now: Instant) -> Self {
        Self {
            stops,
            grace,
            began: now,
            here: BTreeMap::new(),
            gone: BTreeMap::new(),
        }
    }

    /// Notes that a token of a client is there, or is not any more.
    pub(crate) fn set(&mut self, client: &str, token: u64, is_here: bool, now: Instant) {
        // Names of others are not kept: anybody could send them.
        if !self.stops.contains(client) {
            return;
        }
        let here = self.here.entry(client.into()).or_default();
        if is_here {
            here.insert(token);
        } else if here.remove(&token) && here.is_empty() {
            self.gone.insert(client.into(), now);
        }
    }

    /// Returns true if motions of the client stop when it is gone.
    #[must_use]
    pub(crate) fn stops(&self, client: &str) -> bool {
        self.stops.contains(client)
    }

    /// Returns true if a motion of the client may begin.
    #[must_use]
    pub(crate) fn may_begin(&self, client: &str) -> bool {
        !self.stops.contains(client) || self.is_here(client)
    }

    /// Returns true if motions of the client must be stopped.
    #[must_use]
    pub(crate) fn must_stop(&self, client: &str, now: Instant) -> bool {
        let since = self.gone.get(client).copied().unwrap_or(self.began);
        self.stops.contains(client) && !self.is_here(client) && now - since >= self.grace
    }

    fn is_here(&self, client: &str) -> bool {
        self.here.get(client).is_some_and(|here| !here.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_of_a_client_stop_some_time_after_it_was_there() {
        let begin = Instant::now();
        let after = |ms| begin + Duration::from_millis(ms);
        let grace = Duration::from_millis(100);
        let mut presence = Presence::new(["lab".to_owned()].into(), grace, begin);
        assert!(!presence.must_stop("lab", after(99)) && presence.must_stop("lab", after(100)));
        assert!(!presence.may_begin("lab") && presence.may_begin("desk"));
        presence.set("lab", 1, true, after(200));
        presence.set("lab", 2, true, after(300));
        presence.set("lab", 1, false, after(400));
        assert!(!presence.must_stop("lab", after(900)) && presence.may_begin("lab"));
        presence.set("lab", 2, false, after(1000));
        assert!(!presence.must_stop("lab", after(1099)) && presence.must_stop("lab", after(1100)));
        assert!(!presence.must_stop("desk", after(9000)));
    }
}
