//! [`Controller`]: the interrupts of simulated boards.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard};

use super::Model;
use super::bus::lock;
use crate::interrupt::{InterruptController, InterruptLevel, InterruptVector};

/// A simulated [`InterruptController`] for tests. Models of boards or the test itself raise its
/// lines. Clones share one controller.
#[derive(Clone, Default)]
pub struct Controller {
    inside: Arc<Mutex<Inside>>,
}

#[derive(Default)]
struct Inside {
    enabled: BTreeMap<InterruptVector, InterruptLevel>,
    boards: Vec<(InterruptVector, Arc<Mutex<dyn Model>>)>,
    /// Lines that a test holds up.
    raised: BTreeMap<InterruptVector, bool>,
    /// Claimed and not completed.
    claimed: Vec<InterruptVector>,
}

impl Inside {
    fn is_pending(&self, vector: InterruptVector) -> bool {
        let asked = |(line, board): &(InterruptVector, Arc<Mutex<dyn Model>>)| {
            *line == vector && lock(board).interrupts()
        };
        self.raised.get(&vector) == Some(&true) || self.boards.iter().any(asked)
    }
}

impl Controller {
    /// Makes a controller to which no board is connected, with all vectors disabled.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Connects the interrupt request of the model `board` to `vector`.
    pub fn connect<M: Model + 'static>(&self, vector: InterruptVector, board: Arc<Mutex<M>>) {
        self.inside().boards.push((vector, board));
    }

    /// Raises (`true`) or lowers (`false`) the line of `vector`. A line also counts as raised while
    /// a connected board asks for an interrupt.
    pub fn set(&self, vector: InterruptVector, raised: bool) {
        self.inside().raised.insert(vector, raised);
    }

    /// Returns true if an enabled vector is pending, so that [`claim`](InterruptController::claim)
    /// would return it.
    #[must_use]
    pub fn is_pending(&self) -> bool {
        self.most_urgent().is_some()
    }

    /// Returns true if `vector` is enabled.
    #[must_use]
    pub fn is_enabled(&self, vector: InterruptVector) -> bool {
        self.inside().enabled.contains_key(&vector)
    }

    fn most_urgent(&self) -> Option<InterruptVector> {
        let inside = self.inside();
        let pending = inside.enabled.iter().filter(|&(vector, level)| {
            level.0 > 0 && !inside.claimed.contains(vector) && inside.is_pending(*vector)
        });
        // Of one level, the lowest vector.
        pending
            .max_by_key(|&(vector, level)| (*level, core::cmp::Reverse(*vector)))
            .map(|(vector, _)| *vector)
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        lock(&self.inside)
    }
}

impl InterruptController for Controller {
    fn enable(&self, vector: InterruptVector, level: InterruptLevel) {
        self.inside().enabled.insert(vector, level);
    }

    fn disable(&self, vector: InterruptVector) {
        self.inside().enabled.remove(&vector);
    }

    fn claim(&self) -> Option<InterruptVector> {
        let vector = self.most_urgent()?;
        self.inside().claimed.push(vector);
        Some(vector)
    }

    fn complete(&self, vector: InterruptVector) {
        self.inside().claimed.retain(|&claimed| claimed != vector);
    }
}
