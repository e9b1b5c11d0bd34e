//! The rules that a hand keeps.

mod finger;
mod machine;
mod place;
mod shared;
mod stop;

pub(in crate::config) use place::Path;
use place::{Examiner, Root};

use super::{Hand, Mistake};

impl<const FINGERS: usize, const JOINTS: usize> Hand<FINGERS, JOINTS> {
    /// Checks that a controller can be made from this hand.
    ///
    /// Call it for a hand that was made or changed in code. `from_toml` (feature `text`) and
    /// [`from_image`](Self::from_image) have called it already.
    ///
    /// # Errors
    /// Returns the first [`Mistake`] if the hand has one, in this order: the processors, each finger, the
    /// table, and the rules for several of them together, which are channels and load.
    pub fn check(&self) -> Result<(), Mistake> {
        self.examine(&mut Path::new())
    }

    /// `check`, which leaves the way to the mistake in `path`.
    pub(in crate::config) fn examine(&self, path: &mut Path) -> Result<(), Mistake> {
        let mut examiner = Examiner::new(self, path);
        examiner.rates()?;
        examiner.constants()?;
        examiner.processors()?;
        examiner.not_empty(Root::Hand, "fingers", self.fingers.is_empty())?;
        for (index, finger) in self.fingers.iter().enumerate() {
            examiner.finger(index, finger)?;
        }
        examiner.axes()?;
        examiner.channels()?;
        examiner.load()
    }
}
