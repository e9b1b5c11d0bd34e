//! Where a mistake is.

use core::fmt::{self, Write};

use crate::Requirement;
use crate::config::{Field, Hand, Mistake, Name, Owner, ValuePlace};

/// The way to a value from the top of the file, such as `fingers[1].joints[2].limits.low`.
pub(in crate::config) type Path = heapless::String<63, u8>;

pub(super) const POSITIVE: Requirement = Requirement::Above(0.0);
pub(super) const NOT_NEGATIVE: Requirement = Requirement::AtLeast(0.0);

/// What has a value, by indices.
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

    /// Notes the way to a value that is wrong.
    pub(super) fn wrong(&mut self, root: Root, field: &str) -> ValuePlace {
        self.path.clear();
        // A way longer than the path leads to what is around the value.
        let _ = write!(
            self.path,
            "{root}{}{field}",
            if root == Root::Hand { "" } else { "." }
        );
        place(self.hand, root, field)
    }

    /// Notes the way to a thing that is wrong as a whole.
    pub(super) fn wrong_whole(&mut self, root: Root) -> Owner {
        self.path.clear();
        let _ = write!(self.path, "{root}");
        owner(self.hand, root)
    }

    pub(super) fn number(
        &mut self,
        root: Root,
        field: &str,
        value: f64,
        must: Requirement,
    ) -> Result<(), Mistake> {
        if must.holds(value) {
            return Ok(());
        }
        let place = self.wrong(root, field);
        Err(Mistake::Number { place, value, must })
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

    pub(super) fn below(
        &mut self,
        root: Root,
        table: &str,
        (field, value): (&str, f64),
        (upper, limit): (&'static str, f64),
    ) -> Result<(), Mistake> {
        if value < limit {
            return Ok(());
        }
        let place = self.wrong(root, &join(table, field));
        Err(Mistake::Order {
            place,
            value,
            upper,
            limit,
        })
    }

    pub(super) fn cutoff(
        &mut self,
        root: Root,
        field: &str,
        cutoff_hz: f64,
        rate_hz: u32,
    ) -> Result<(), Mistake> {
        self.number(root, field, cutoff_hz, POSITIVE)?;
        // A filter that is slower still would never move.
        let least = 1e-9 * f64::from(rate_hz);
        self.number(root, field, cutoff_hz, Requirement::AtLeast(least))?;
        if cutoff_hz < 0.5 * f64::from(rate_hz) {
            return Ok(());
        }
        let place = self.wrong(root, field);
        Err(Mistake::Cutoff {
            place,
            cutoff_hz,
            rate_hz,
        })
    }

    /// The name must have letters, and not be that of an earlier sibling.
    pub(super) fn name<'n>(
        &mut self,
        root: Root,
        name: &Name,
        mut earlier: impl Iterator<Item = &'n Name>,
    ) -> Result<(), Mistake> {
        if name.trim().is_empty() {
            let place = self.wrong(root, "name");
            return Err(Mistake::NoName { place });
        }
        if earlier.any(|other| other == name) {
            self.wrong(root, "name");
            let owner = owner(self.hand, root);
            return Err(Mistake::SameName { owner });
        }
        Ok(())
    }
}

/// The way to a field within a table.
pub(super) fn join(table: &str, field: &str) -> Field {
    let mut whole = Field::new();
    let dot = if table.is_empty() || field.is_empty() {
        ""
    } else {
        "."
    };
    // What does not fit leads to the table.
    let _ = whole.push_str(table);
    let _ = whole.push_str(dot);
    let _ = whole.push_str(field);
    whole
}

/// The place of a path that begins with a root.
pub(super) fn resolve<const FINGERS: usize, const JOINTS: usize>(
    hand: &Hand<FINGERS, JOINTS>,
    path: &str,
) -> ValuePlace {
    if let Some((finger, rest)) = entry(path, "fingers[") {
        return match entry(rest, "joints[") {
            Some((joint, field)) => place(hand, Root::Joint(finger, joint), field),
            None => place(hand, Root::Finger(finger), rest),
        };
    }
    if let Some((processor, field)) = entry(path, "processors[") {
        return place(hand, Root::ControlProcessor(processor), field);
    }
    match entry(path, "table.axes[") {
        Some((axis, field)) => place(hand, Root::Axis(axis), field),
        None => place(hand, Root::Hand, path),
    }
}

/// The index and the rest of a path into this list.
fn entry<'p>(path: &'p str, list: &str) -> Option<(usize, &'p str)> {
    let (index, rest) = path.strip_prefix(list)?.split_once(']')?;
    Some((index.parse().ok()?, rest.strip_prefix('.')?))
}

fn place<const FINGERS: usize, const JOINTS: usize>(
    hand: &Hand<FINGERS, JOINTS>,
    root: Root,
    field: &str,
) -> ValuePlace {
    ValuePlace {
        owner: owner(hand, root),
        field: join(field, ""),
    }
}

pub(super) fn owner<const FINGERS: usize, const JOINTS: usize>(
    hand: &Hand<FINGERS, JOINTS>,
    root: Root,
) -> Owner {
    let finger = |index: usize| hand.fingers.get(index).map(|finger| finger.name.clone());
    let joint = |index: usize, joint| hand.joint(index, joint).map(|joint| joint.name.clone());
    match root {
        Root::Hand => Owner::Hand,
        Root::ControlProcessor(index) => {
            let processor = hand.processors.get(index);
            Owner::ControlProcessor(processor.map_or(0, |processor| processor.number))
        }
        Root::Axis(index) => {
            let axis = hand.table.as_ref().and_then(|table| table.axes.get(index));
            Owner::Axis(axis.map(|axis| axis.name.clone()).unwrap_or_default())
        }
        Root::Finger(index) => Owner::Finger(finger(index).unwrap_or_default()),
        Root::Joint(index, number) => Owner::Joint {
            finger: finger(index).unwrap_or_default(),
            joint: joint(index, number).unwrap_or_default(),
        },
    }
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
