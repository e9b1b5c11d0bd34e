//! [`Plan`]: at which points interrupts come.

use std::cell::Cell;

/// How deep interrupts come within interrupts.
const LEVELS: usize = 3;

/// What an interrupt finds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One event is due.
    OnTime,
    /// Two are.
    Late,
    /// None is.
    WithoutCause,
}

/// The point of the run at which an interrupt comes, the point of that interrupt at which the next
/// one comes, and so on; from 1 on, 0 for none.
pub(super) type Points = [u32; LEVELS];

/// The interrupts of one run.
pub(super) struct Plan {
    pub(super) kind: Kind,
    left: [Cell<u32>; LEVELS],
    level: Cell<usize>,
}

impl Plan {
    pub(super) fn new(kind: Kind, points: Points) -> Self {
        Self {
            kind,
            left: points.map(Cell::new),
            level: Cell::new(0),
        }
    }

    /// Counts a point; has the interrupt come if it is its turn.
    pub(super) fn point(&self, interrupt: impl FnOnce(Kind)) {
        let level = self.level.get();
        let Some(left) = self.left.get(level) else {
            return;
        };
        match left.get() {
            0 => return,
            more => left.set(more - 1),
        }
        if left.get() == 0 {
            self.level.set(level + 1);
            interrupt(self.kind);
            self.level.set(level);
        }
    }

    /// Whether every interrupt has come.
    pub(super) fn is_done(&self) -> bool {
        self.left.iter().all(|left| left.get() == 0)
    }
}

/// Makes a run for all points that there are, as long as `run` says that all of its interrupts have
/// come; gives the number of runs.
pub(super) fn for_all_points(kind: Kind, mut run: impl FnMut(Plan) -> bool) -> u64 {
    let mut runs = 0;
    let mut reaches = |points| {
        runs += 1;
        run(Plan::new(kind, points))
    };
    let mut first = 0;
    while reaches([first, 0, 0]) {
        let mut second = 1;
        while first > 0 && reaches([first, second, 0]) {
            let mut third = 1;
            while reaches([first, second, third]) {
                third += 1;
            }
            second += 1;
        }
        first += 1;
    }
    runs
}
