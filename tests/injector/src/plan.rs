//! [`Plan`]: the points of a run at which interrupts come, and [`explore`], which tries all plans.

use std::cell::Cell;
use std::ops::Range;
use std::rc::Rc;

use crate::points::with_points;

/// The interrupts that may come in one run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interrupts {
    /// Up to this many interrupts, each within the previous one.
    Nested(usize),
    /// Up to `most` interrupts, each after the beginning of the previous one: within it or not. Each is of
    /// one of `sources`; a source interrupts the background and the sources of lower numbers.
    Ranked {
        /// The greatest number of interrupts in one run.
        most: usize,
        /// The number of sources.
        sources: usize,
    },
}

impl Interrupts {
    const fn most(self) -> usize {
        match self {
            Self::Nested(most) | Self::Ranked { most, .. } => most,
        }
    }
}

/// The interrupts of one run.
#[derive(Debug)]
pub struct Plan {
    interrupts: Interrupts,
    /// The points at which interrupts come, counted from 0 in the order in which the run reaches them,
    /// and the source of each. Sources of nested interrupts are numbered by depth.
    places: Vec<(u32, usize)>,
    /// The number of interrupts that have come.
    came: Cell<usize>,
    /// The number of points that have passed.
    passed: Cell<u32>,
    /// The number of points that had passed when the last interrupt that has a place returned.
    last_ended: Cell<u32>,
    /// Sources of lower numbers cannot interrupt at present.
    level: Cell<usize>,
}

impl Plan {
    fn new(interrupts: Interrupts, places: Vec<(u32, usize)>) -> Rc<Self> {
        Rc::new(Self {
            interrupts,
            places,
            came: Cell::new(0),
            passed: Cell::new(0),
            last_ended: Cell::new(0),
            level: Cell::new(0),
        })
    }

    /// Runs `program`, which calls `interrupt` with a source where the plan says so.
    pub fn run<R>(
        self: &Rc<Self>,
        interrupt: impl Fn(usize) + 'static,
        program: impl FnOnce() -> R,
    ) -> R {
        let plan = Rc::clone(self);
        with_points(Rc::new(move || plan.point(&interrupt)), program)
    }

    /// Counts a point, and calls `interrupt` with a source if its turn has come.
    pub fn point(&self, interrupt: impl Fn(usize)) {
        let here = self.passed.get();
        self.passed.set(here + 1);
        while let Some(&(point, source)) = self.places.get(self.came.get())
            && point == here
            && source >= self.level.get()
        {
            self.came.set(self.came.get() + 1);
            let is_last = self.came.get() == self.places.len();
            let level = self.level.replace(source + 1);
            interrupt(source);
            self.level.set(level);
            if is_last {
                self.last_ended.set(self.passed.get());
            }
        }
    }

    /// Returns how many interrupts are placed.
    #[must_use]
    pub fn placed(&self) -> usize {
        self.places.len()
    }

    /// Returns the point of the first interrupt: 0 is the first of the run.
    #[must_use]
    pub fn first(&self) -> Option<u32> {
        self.places.first().map(|&(point, _)| point)
    }

    /// Returns the places of one more interrupt: none if one of those that are placed did not come.
    fn further(&self) -> (Range<u32>, Range<usize>) {
        let placed = self.places.len();
        let last = self.places.last().map(|&(point, _)| point);
        if self.came.get() < placed || placed == self.interrupts.most() {
            return (0..0, 0..0);
        }
        match self.interrupts {
            Interrupts::Nested(_) => {
                let end = last.map_or(self.passed.get(), |_| self.last_ended.get());
                (last.map_or(0, |last| last + 1)..end, placed..placed + 1)
            }
            Interrupts::Ranked { sources, .. } => {
                (last.unwrap_or(0)..self.passed.get(), 0..sources)
            }
        }
    }
}

/// Calls `run` with a plan for every way to place `interrupts`, the one without any first; returns
/// the number of calls.
///
/// Each call runs the same program from the same beginning, with [`Plan::run`].
pub fn explore(interrupts: Interrupts, mut run: impl FnMut(&Rc<Plan>)) -> u64 {
    let mut left = vec![Vec::new()];
    let mut runs = 0;
    while let Some(places) = left.pop() {
        let plan = Plan::new(interrupts, places);
        run(&plan);
        runs += 1;
        let (points, sources) = plan.further();
        // The last that is put in is the next that is tried: at the earliest point, of the first source.
        for point in points.rev() {
            for source in sources.clone().rev() {
                let mut places = plan.places.clone();
                places.push((point, source));
                left.push(places);
            }
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use super::{Interrupts, explore};
    use crate::points::{Section, point};

    /// Returns the orders in which two steps and the ends of interrupts of one step come.
    fn orders(interrupts: Interrupts) -> Vec<String> {
        let mut orders = Vec::new();
        explore(interrupts, |plan| {
            let log = Rc::new(RefCell::new(String::new()));
            let seen = Rc::clone(&log);
            let interrupt = move |source: usize| {
                seen.borrow_mut().push('(');
                point();
                seen.borrow_mut().push_str(&source.to_string());
                seen.borrow_mut().push(')');
            };
            plan.run(interrupt, || {
                point();
                log.borrow_mut().push('a');
                let _section = Section::enter();
                point();
                log.borrow_mut().push('b');
            });
            orders.push(log.take());
        });
        orders.sort();
        orders
    }

    #[test]
    fn each_place_is_tried_once() {
        let one = ["(0)ab", "a(0)b", "ab", "ab(0)"];
        assert_eq!(orders(Interrupts::Nested(1)), one);
        let mut two: Vec<_> = one.to_vec();
        two.extend(["((1)0)ab", "a((1)0)b", "ab((1)0)"]);
        two.sort_unstable();
        assert_eq!(orders(Interrupts::Nested(2)), two);
    }

    #[test]
    fn a_source_is_not_interrupted_by_itself() {
        let sources = 1;
        let found = orders(Interrupts::Ranked { most: 2, sources });
        assert!(found.contains(&"(0)a(0)b".into()) && found.contains(&"(0)(0)ab".into()));
        assert!(!found.iter().any(|order| order.contains("((")));
    }
}
