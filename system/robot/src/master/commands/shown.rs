//! The lines that `status` shows, of at most 80 columns.

use core::fmt::{self, Display, Write as _};

use condor_hand::config::Finger;
use condor_hand::decimal::Decimal;
use condor_hand::servo::ServoMode;

use crate::master::servos::are_all;
use crate::message::ServoStatus;
use crate::plant::CameraObject;
use crate::{ACTUATORS, JOINTS};

/// The columns of a name, and of how a finger is.
const NAME: usize = 6;
const CONDITION: usize = 10;

/// Over the rows of fingers whose joints are called the same.
pub(super) struct Titles<'h>(pub(super) &'h Finger<JOINTS, ACTUATORS>);

impl Titles<'_> {
    /// Returns true if another finger may stand below them.
    pub(super) fn suit(&self, other: &Finger<JOINTS, ACTUATORS>) -> bool {
        let mut names = self.0.joints.iter().zip(&other.joints);
        names.all(|(a, b)| a.name == b.name)
    }
}

impl Display for Titles<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<NAME$} {:<CONDITION$} on", "finger", "is")?;
        for joint in &self.0.joints {
            let width = column(&joint.name);
            write!(f, "{:>width$}", joint.name.as_str())?;
        }
        f.write_str("  rad")
    }
}

/// A finger: how it is, on which processor, and where its joints are, if that is known, rad.
pub(super) struct Row<'h> {
    pub(super) finger: &'h Finger<JOINTS, ACTUATORS>,
    pub(super) status: Option<&'h ServoStatus<JOINTS>>,
    pub(super) processor: u8,
    pub(super) measured: Option<[f64; JOINTS]>,
}

impl Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.finger.name.as_str();
        let condition = condition(self.status);
        let processor = self.processor;
        write!(f, "{name:<NAME$} {condition:<CONDITION$} {processor:>2}")?;
        for (number, joint) in self.finger.joints.iter().enumerate() {
            let width = column(&joint.name);
            match self.measured.and_then(|all| all.get(number).copied()) {
                Some(position) => {
                    let mut text = heapless::String::<16>::new();
                    // No joint has as many digits.
                    let _ = write!(text, "{:.3}", Decimal(position));
                    write!(f, "{text:>width$}")?;
                }
                None => write!(f, "{:>width$}", "-")?,
            }
        }
        Ok(())
    }
}

/// Room for a title and for a position, and a blank before it.
fn column(name: &str) -> usize {
    name.len().max(6) + 2
}

/// Returns the condition of a finger, in a word or two.
fn condition(status: Option<&ServoStatus<JOINTS>>) -> &'static str {
    let Some(status) = status else {
        return "gone";
    };
    let first = status.modes.first().copied().unwrap_or_default();
    if status.fault.is_some() {
        "fault"
    } else if status.is_resting {
        "rests"
    } else if !are_all(status, first) {
        "mixed"
    } else {
        match first {
            ServoMode::Off => "off",
            ServoMode::Effort => "by effort",
            ServoMode::Torque => "by torque",
            ServoMode::Position => "follows",
            ServoMode::Grasp => "holds",
            ServoMode::Impedance => "impedance",
        }
    }
}

/// The modes of a finger whose joints are in several: the joints of each.
pub(super) struct MixedModes<'h> {
    finger: &'h Finger<JOINTS, ACTUATORS>,
    modes: &'h [ServoMode],
}

impl<'h> MixedModes<'h> {
    /// `None` for a finger whose joints are all in one mode.
    pub(super) fn of(
        finger: &'h Finger<JOINTS, ACTUATORS>,
        status: &'h ServoStatus<JOINTS>,
    ) -> Option<Self> {
        let modes = status.modes.as_slice();
        let is_mixed = modes.iter().any(|mode| Some(mode) != modes.first());
        is_mixed.then_some(Self { finger, modes })
    }
}

impl Display for MixedModes<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.finger.name)?;
        let mut semicolon = "";
        for mode in ServoMode::ALL {
            if !self.modes.contains(&mode) {
                continue;
            }
            write!(f, "{semicolon} {}", mode.name())?;
            for (joint, _) in self
                .finger
                .joints
                .iter()
                .zip(self.modes)
                .filter(|(_, other)| **other == mode)
            {
                write!(f, " {}", joint.name)?;
            }
            semicolon = ";";
        }
        Ok(())
    }
}

/// An object as it is measured.
pub(super) struct MeasuredObject<'o>(pub(super) &'o CameraObject);

impl Display for MeasuredObject<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.position.map(Decimal);
        let radius = Decimal(self.0.radius_m);
        write!(
            f,
            "a ball of {radius:.4} m at {x:.4} {y:.4} {z:.4} m from the palm"
        )
    }
}

/// A number of motions.
pub(super) struct MotionCount(pub(super) u32);

impl Display for MotionCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let s = if self.0 == 1 { "" } else { "s" };
        write!(f, "{} motion{s}", self.0)
    }
}

/// D/A boards, a bit for each, by their numbers.
pub(super) struct Boards(pub(super) u64);

impl Display for Boards {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut comma = "";
        for board in (0..u64::BITS).filter(|board| self.0 >> board & 1 != 0) {
            write!(f, "{comma}{board}")?;
            comma = ", ";
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_are_told_by_their_numbers() {
        assert_eq!(std::format!("{}", Boards(0b1011)), "0, 1, 3");
    }
}
