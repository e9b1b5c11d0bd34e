//! [`TrackingReport`]: how well the joints have followed each motion, which the master publishes.

use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::servo::Figures;

/// The name of the published [`TrackingReport`] in the master's object table.
pub const FOLLOWED_NAME: &str = "followed";
/// The longest name of a motion, bytes.
const NAME_BYTES: usize = 24;
/// Motions with a name of their own, at most.
const MOTIONS: usize = 8;

/// The tracking errors of all motions that came to their ends, by the names of the motions. The master publishes it
/// after each motion. There is room for eight names; motions with further names are left out.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct TrackingReport {
    motions: [TrackedMotion; MOTIONS],
}

/// The tracking errors of one motion of a [`TrackingReport`], over all of its runs.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct TrackedMotion {
    /// UTF-8, with zeros after it; nothing for no motion.
    name: [u8; NAME_BYTES],
    /// The number of times that the motion has run.
    pub runs: u64,
    /// The tracking errors of all joints.
    pub figures: Figures,
}

impl TrackingReport {
    /// Iterates over the motions with their names, in the order of their first runs.
    pub fn motions(&self) -> impl Iterator<Item = (&str, &TrackedMotion)> {
        let named = self.motions.iter().map(|motion| (motion.name(), motion));
        named.filter(|(name, _)| !name.is_empty())
    }

    /// Adds a run.
    pub(crate) fn add(&mut self, name: &str, figures: &Figures) {
        let mut motions = self.motions.iter_mut();
        let place = motions.find(|motion| motion.name().is_empty() || motion.name() == name);
        if let Some(motion) = place
            && let Some(bytes) = motion.name.get_mut(..name.len())
        {
            bytes.copy_from_slice(name.as_bytes());
            motion.runs = motion.runs.wrapping_add(1);
            motion.figures.merge(figures);
        }
    }
}

impl TrackedMotion {
    fn name(&self) -> &str {
        let len = self.name.iter().take_while(|&&byte| byte != 0).count();
        let name = self.name.get(..len).unwrap_or(&[]);
        core::str::from_utf8(name).unwrap_or("")
    }
}

#[cfg(test)]
mod tests {
    use zerocopy::FromZeros as _;

    use super::*;

    #[test]
    fn runs_of_a_name_are_one_motion_and_the_ninth_name_is_left_out() {
        let mut followed = TrackingReport::new_zeroed();
        let figures = Figures::default();
        for name in [
            "wave", "open", "wave", "c", "d", "e", "f", "g", "h", "i", "wave",
        ] {
            followed.add(name, &figures);
        }
        let all: std::vec::Vec<_> = followed
            .motions()
            .map(|(name, it)| (name, it.runs))
            .collect();
        assert_eq!(all.len(), MOTIONS);
        assert_eq!(all[..3], [("wave", 3), ("open", 1), ("c", 1)]);
    }
}
