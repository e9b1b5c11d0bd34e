//! The place of a mistake in a configuration.

use core::fmt::{self, Write};

use crate::Requirement;
use crate::config::{
    Finger, Hand, Mistake, MistakeField, MistakeOwner, MistakePlace, Name, Problem,
};
use crate::math::{abs, is_finite};

/// The way to a value from the top of the file, such as `fingers[1].joints[2].limits.low`.
pub(in crate::config) type Path = heapless::String<63, u8>;

pub(super) const POSITIVE: Requirement = Requirement::Above(0.0);
pub(super) const NOT_NEGATIVE: Requirement = Requirement::AtLeast(0.0);
pub(super) const TAKEN: Problem = Problem::Is("is taken already");

/// The largest number that a hand may have, to either side: products of some such numbers are finite.
const MOST: f64 = 1e15;

/// The owner of a value, by indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Root {
    Hand,
    ControlProcessor(usize),
    Axis(usize),
    Finger(usize),
    Joint(usize, usize),
}

/// A hand, and the way to what is wrong with it.
pub(super) struct Examiner<'a, const FINGERS: usize, const JOINTS: usize> {
    pub(super) hand: &'a Hand<FINGERS, JOINTS>,
    path: &'a mut Path,
}

impl<'a, const FINGERS: usize, const JOINTS: usize> Examiner<'a, FINGERS, JOINTS> {
    pub(super) fn new(hand: &'a Hand<FINGERS, JOINTS>, path: &'a mut Path) -> Self {
        Self { hand, path }
    }

    /// The mistake of a value, or of a whole thing if there is no field; notes the way to it.
    pub(super) fn wrong(&mut self, root: Root, field: &str, problem: Problem) -> Mistake {
        self.path.clear();
        let dot = if root == Root::Hand || field.is_empty() {
            ""
        } else {
            "."
        };
        // A way longer than the path leads to what is around the value.
        let _ = write!(self.path, "{root}{dot}{field}");
        let place = self.place(root, field);
        Mistake { place, problem }
    }

    /// Refuses a number that is not finite or too large to compute with, and one that is not what it
    /// must be.
    pub(super) fn number(
        &mut self,
        root: Root,
        field: &str,
        value: f64,
        must: Requirement,
    ) -> Result<(), Mistake> {
        let must = if !is_finite(value) {
            Requirement::Finite
        } else if abs(value) <= MOST {
            must
        } else if value > 0.0 {
            Requirement::AtMost(MOST)
        } else {
            Requirement::AtLeast(-MOST)
        };
        if must.holds(value) {
            return Ok(());
        }
        Err(self.wrong(root, field, Problem::Number { value, must }))
    }

    pub(super) fn numbers<const N: usize>(
        &mut self,
        root: Root,
        table: &str,
        rows: [(&str, f64, Requirement); N],
    ) -> Result<(), Mistake> {
        for (field, value, must) in rows {
            self.number(root, &join(table, field), value, must)?;
        }
        Ok(())
    }

    /// Refuses a list with a number that cannot be computed with.
    pub(super) fn list(&mut self, root: Root, field: &str, list: &[f64]) -> Result<(), Mistake> {
        for (index, &value) in list.iter().enumerate() {
            let mut entry = join(field, "");
            // If the index does not fit, the path leads to the list.
            let _ = write!(entry, "[{index}]");
            self.number(root, &entry, value, Requirement::Finite)?;
        }
        Ok(())
    }

    pub(super) fn below(
        &mut self,
        root: Root,
        table: &str,
        (field, value): (&str, f64),
        (upper, limit): (&'static str, f64),
    ) -> Result<(), Mistake> {
        let field = join(table, field);
        self.number(root, &join(table, upper), limit, Requirement::Finite)?;
        self.number(root, &field, value, Requirement::Finite)?;
        if value < limit {
            return Ok(());
        }
        Err(self.wrong(
            root,
            &field,
            Problem::Order {
                value,
                upper,
                limit,
            },
        ))
    }

    pub(super) fn cutoff(
        &mut self,
        root: Root,
        field: &str,
        cutoff_hz: f64,
        rate_hz: u32,
    ) -> Result<(), Mistake> {
        let rate_hz = f64::from(rate_hz);
        // A filter that is slower still would never move.
        for must in [
            POSITIVE,
            Requirement::AtLeast(1e-9 * rate_hz),
            Requirement::Below(0.5 * rate_hz),
        ] {
            self.number(root, field, cutoff_hz, must)?;
        }
        Ok(())
    }

    pub(super) fn not_empty(
        &mut self,
        root: Root,
        field: &str,
        is_empty: bool,
    ) -> Result<(), Mistake> {
        if is_empty {
            return Err(self.wrong(root, field, Problem::Is("is empty")));
        }
        Ok(())
    }

    /// The name must have letters, and not be that of an earlier sibling.
    pub(super) fn name<'n>(
        &mut self,
        root: Root,
        name: &Name,
        mut earlier: impl Iterator<Item = &'n Name>,
    ) -> Result<(), Mistake> {
        self.not_empty(root, "name", name.trim().is_empty())?;
        if earlier.any(|other| other == name) {
            return Err(self.wrong(root, "name", TAKEN));
        }
        Ok(())
    }

    pub(super) fn place(&self, root: Root, field: &str) -> MistakePlace {
        let finger = |index: usize| self.hand.fingers.get(index);
        let name = |finger: Option<&Finger<JOINTS>>| {
            finger.map(|finger| finger.name.clone()).unwrap_or_default()
        };
        let owner = match root {
            Root::Hand => MistakeOwner::Hand,
            Root::ControlProcessor(index) => {
                let processor = self.hand.processors.get(index);
                MistakeOwner::ControlProcessor(processor.map_or(0, |processor| processor.number))
            }
            Root::Axis(index) => {
                let axis = self
                    .hand
                    .table
                    .as_ref()
                    .and_then(|table| table.axes.get(index));
                MistakeOwner::Axis(axis.map(|axis| axis.name.clone()).unwrap_or_default())
            }
            Root::Finger(index) => MistakeOwner::Finger(name(finger(index))),
            Root::Joint(index, number) => {
                let joint = self.hand.joint(index, number);
                MistakeOwner::Joint {
                    finger: name(finger(index)),
                    joint: joint.map(|joint| joint.name.clone()).unwrap_or_default(),
                }
            }
        };
        let field = join(field, "");
        MistakePlace { owner, field }
    }
}

/// The way to a field within a table.
pub(super) fn join(table: &str, field: &str) -> MistakeField {
    let mut whole = MistakeField::new();
    let dot = if table.is_empty() || field.is_empty() {
        ""
    } else {
        "."
    };
    // If the rest does not fit, the path leads to the table.
    let _ = whole.push_str(table);
    let _ = whole.push_str(dot);
    let _ = whole.push_str(field);
    whole
}

impl fmt::Display for Root {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hand => Ok(()),
            Self::ControlProcessor(index) => write!(f, "processors[{index}]"),
            Self::Axis(index) => write!(f, "table.axes[{index}]"),
            Self::Finger(index) => write!(f, "fingers[{index}]"),
            Self::Joint(finger, joint) => write!(f, "fingers[{finger}].joints[{joint}]"),
        }
    }
}
